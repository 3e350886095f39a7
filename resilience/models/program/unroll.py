"""From stages and a tree to one sparse program: a chain is a horizon, a fan a two-stage program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.form import Form, stage_form
from resilience.models.program.standard import StageCopies, Standard
from resilience.models.structures import Structure, UnrolledStructure


def unroll(stages: Sequence[Stage], tree: Tree, cuts: Sequence[Cut] = ()) -> Standard:
    """Copies each node's stage, joins every state to the parent's, and stacks all of it.

    Args:
        stages: one per distinct node duration; `tree.stage` says which node is which. All declare
            the same states.
        tree: parents, probabilities and labels of the nodes.
        cuts: lower bounds on the future cost behind every leaf (terminal values).

    Raises:
        ValueError: the stages declare different states.
    """
    forms = [stage_form(stage) for stage in stages]
    n_states = _same_states(forms)
    first_column, n_columns = _offsets([f.n_own for f in forms], tree, n_states + len(tree.leaves))
    first_row, n_rows = _offsets([f.n_rows for f in forms], tree, 0)
    state_ends = _state_ends(forms, tree, first_column, n_states)
    copies = []
    for k, form in enumerate(forms):
        nodes = np.flatnonzero(tree.stage == k)
        own_columns = first_column[nodes, None] + np.arange(form.n_own)
        columns = np.concatenate([state_ends[tree.parent[nodes]], own_columns], axis=1)
        rows = first_row[nodes, None] + np.arange(form.n_rows)
        copies.append(StageCopies(form, nodes, columns, rows))
    integer, equality = np.zeros(n_columns, bool), np.zeros(n_rows, bool)
    for stage in copies:
        integer[stage.own_columns] = stage.form.integer
        built, *_, in_units = stage.form.design_numbers
        integer[built] = in_units  # the states at the start come first in both numberings
        equality[stage.rows] = stage.form.equality
    standard = Standard(
        tree=tree,
        copies=tuple(copies),
        a=_matrix(copies, (n_rows, n_columns)),
        structures=tuple(
            _unrolled(structure, matrices, stage, n_columns)
            for stage in copies
            for structure, matrices in stage.form.structures
        ),
        cuts=(),
        n_states=n_states,
        integer=integer,
        equality=equality,
    )
    return _with_cuts(standard, tuple(cuts)) if cuts else standard


def _same_states(forms: Sequence[Form]) -> int:
    declared = [[(b.name, b.labels) for _, b in form.stage.states] for form in forms]
    if any(states != declared[0] for states in declared):
        raise ValueError("all stages of a tree must declare the same states in the same order")
    return forms[0].n_now


def _offsets(sizes: list[int], tree: Tree, start: int) -> tuple[Ints, int]:
    """(nodes,) where each node begins that takes `sizes` of its stage, and where the last ends."""
    node_sizes = np.asarray(sizes, np.intp)[tree.stage]
    ends = start + np.cumsum(node_sizes)
    return ends - node_sizes, int(ends[-1])


def _state_ends(forms: Sequence[Form], tree: Tree, first_column: Ints, n_states: int) -> Ints:
    """(nodes + 1, states): columns of the states at a node's end.

    The last row holds those at the start, so that the parent -1 of a root finds them there. A
    design has the same columns everywhere: those at the start.
    """
    ends = np.empty((tree.n + 1, n_states), np.intp)
    ends[-1] = np.arange(n_states)
    none = np.empty(0, np.intp)
    own_places = [
        np.concatenate([none, *(f.columns(after) for _, after in f.stage.states)]) - f.n_now
        for f in forms
    ]
    built = forms[0].design_numbers[0]
    for node in range(tree.n):
        ends[node] = first_column[node] + own_places[tree.stage[node]]
    ends[:, built] = built
    return ends


def _matrix(copies: Sequence[StageCopies], shape: tuple[int, int]) -> sp.csr_array:
    rows, columns, values = [], [], []
    for stage in copies:
        a = stage.form.a
        rows.append(stage.rows[:, a.row].ravel())
        columns.append(stage.columns[:, a.col].ravel())
        values.append(np.tile(a.data, len(stage.nodes)))
    triplets = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return sp.csr_array(triplets, shape=shape)


def _unrolled(
    structure: Structure, matrices: Sequence[sp.csr_array], stage: StageCopies, n_columns: int
) -> UnrolledStructure[Structure]:
    n = len(stage.nodes)

    def spread(matrix: sp.csr_array) -> sp.csr_array:
        counts = np.tile(np.diff(matrix.indptr), n)
        starts = np.concatenate([[0], np.cumsum(counts)])
        columns = stage.columns[:, matrix.indices].ravel()
        entries = (np.tile(matrix.data, n), columns, starts)
        return sp.csr_array(entries, shape=(n * matrix.shape[0], n_columns))

    def repeat(values: Floats) -> Floats:
        return np.tile(values, n)

    return UnrolledStructure(
        structure=structure,
        nodes=stage.nodes,
        matrices=tuple(spread(m) for m in matrices),
        consts=tuple(repeat(arg.const) for arg in structure.args),
        limits=tuple(repeat(limit) for limit in structure.limits),
    )


def _with_cuts(standard: Standard, cuts: tuple[Cut, ...]) -> Standard:
    """The same program with a row per cut and leaf:  beta @ state - future <= -alpha."""
    leaves = standard.tree.leaves
    blocks = []
    for cut in cuts:
        row = sp.lil_array((len(leaves), standard.n_columns))
        for k, leaf in enumerate(leaves):
            row[k, standard.future[k]] = -1.0
            for name, beta in cut.beta.items():
                row[k, standard.columns(name)[:, leaf]] = beta
        blocks.append(row.tocsr())
    return replace(
        standard,
        cuts=cuts,
        a=sp.vstack([standard.a, *blocks], format="csr"),
        equality=np.append(standard.equality, np.zeros(len(leaves) * len(cuts), bool)),
    )
