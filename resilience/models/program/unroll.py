"""From stages and a tree to one sparse problem: a chain is a horizon, a fan a two-stage program."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.form import Form
from resilience.models.program.standard import Standard
from resilience.models.structures import Structure, UnrolledStructure


def unroll(stages: Sequence[Stage], tree: Tree, cuts: Sequence[Cut] = ()) -> Standard:
    """Copies each node's stage, joins every state to the parent's, and stacks all of it.

    Args:
        stages: one per distinct node duration; `tree.stage` says which node is which. All declare
            the same states.
        tree: parents, probabilities and labels of the nodes.
        cuts: lower bounds on the future cost behind every leaf (terminal values).
    """
    forms = tuple(Form(stage) for stage in stages)
    members = tuple(np.flatnonzero(tree.stage == k) for k in range(len(forms)))
    n_states = _same_states(forms)
    first, n_columns = _offsets([f.n_own for f in forms], tree, n_states + len(tree.leaves))
    row_first, n_rows = _offsets([f.n_rows for f in forms], tree, 0)
    ends = _state_ends(forms, tree, first, n_states)
    tables, row_tables = [], []
    for form, nodes in zip(forms, members, strict=True):
        own = first[nodes, None] + np.arange(form.n_own)
        tables.append(np.concatenate([ends[tree.parent[nodes]], own], axis=1))
        row_tables.append(row_first[nodes, None] + np.arange(form.n_rows))
    a = _matrix(forms, tables, row_tables, (n_rows, n_columns))
    integer = np.zeros(n_columns, bool)
    equality = np.zeros(n_rows, bool)
    for form, table, rows in zip(forms, tables, row_tables, strict=True):
        integer[table[:, form.n_now :]] = form.integer
        equality[rows] = form.equality
    structures = tuple(
        _unrolled(structure, matrices, table, nodes, n_columns)
        for form, table, nodes in zip(forms, tables, members, strict=True)
        for structure, matrices in form.structures()
    )
    standard = Standard(
        forms=forms,
        tree=tree,
        tables=tuple(tables),
        members=members,
        row_tables=tuple(row_tables),
        a=a,
        structures=structures,
        cuts=tuple(cuts),
        n_states=n_states,
        integer=integer,
        equality=equality,
    )
    return _with_cuts(standard) if cuts else standard


def _same_states(forms: tuple[Form, ...]) -> int:
    declared = [[(b.name, b.labels) for _, b in form.stage.states] for form in forms]
    if any(other != declared[0] for other in declared):
        raise ValueError("all stages of a tree must declare the same states in the same order")
    return forms[0].n_now


def _offsets(sizes: list[int], tree: Tree, start: int) -> tuple[Ints, int]:
    each = np.asarray(sizes, np.intp)[tree.stage]
    ends = start + np.cumsum(each)
    return ends - each, int(ends[-1])


def _state_ends(forms: tuple[Form, ...], tree: Tree, first: Ints, n_states: int) -> Ints:
    """(nodes + 1, states): columns of the states at a node's end; the last row is the start."""
    ends = np.empty((tree.n + 1, n_states), np.intp)
    ends[-1] = np.arange(n_states)
    places = []
    for form in forms:
        at = [form.position[b.slice] - form.n_now for _, b in form.stage.states]
        places.append(np.concatenate(at) if at else np.empty(0, np.intp))
    for node in range(tree.n):
        ends[node] = first[node] + places[tree.stage[node]]
    return ends


def _matrix(
    forms: tuple[Form, ...], tables: list[Ints], row_tables: list[Ints], shape: tuple[int, int]
) -> sp.csr_array:
    rows, columns, values = [], [], []
    for form, table, row_table in zip(forms, tables, row_tables, strict=True):
        rows.append(row_table[:, form.a.row].ravel())
        columns.append(table[:, form.a.col].ravel())
        values.append(np.tile(form.a.data, len(table)))
    triplets = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(triplets, shape=shape)


def _unrolled(
    structure: Structure, matrices: list[sp.csr_array], table: Ints, nodes: Ints, n_columns: int
) -> UnrolledStructure[Structure]:
    def spread(matrix: sp.csr_array) -> sp.csr_array:
        counts = np.tile(np.diff(matrix.indptr), len(nodes))
        starts = np.concatenate([[0], np.cumsum(counts)])
        entries = (np.tile(matrix.data, len(nodes)), table[:, matrix.indices].ravel(), starts)
        return sp.csr_array(entries, shape=(len(nodes) * matrix.shape[0], n_columns))

    def repeat(values: Floats) -> Floats:
        return np.tile(values, len(nodes))

    return UnrolledStructure(
        structure=structure,
        nodes=nodes,
        matrices=tuple(spread(m) for m in matrices),
        consts=tuple(repeat(arg.const) for arg in structure.args),
        limits=tuple(repeat(limit) for limit in structure.limits),
    )


def _with_cuts(standard: Standard) -> Standard:
    leaves = standard.tree.leaves
    blocks = []
    for cut in standard.cuts:
        row = sp.lil_array((len(leaves), standard.n_columns))
        for k, leaf in enumerate(leaves):
            row[k, standard.future[k]] = -1.0
            for name, beta in cut.beta.items():
                row[k, standard.columns(name)[:, leaf]] = beta
        blocks.append(row.tocsr())
    standard.a = sp.vstack([standard.a, *blocks], format="csr")
    n_cuts = len(leaves) * len(standard.cuts)
    standard.equality = np.concatenate([standard.equality, np.zeros(n_cuts, bool)])
    return standard
