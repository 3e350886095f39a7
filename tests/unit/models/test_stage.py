"""What a stage and a tree refuse, and what a tree means."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.form import stage_form
from resilience.models.program.unroll import unroll


def twice(stage: Stage) -> None:
    stage.var("x", ["a", "b"])


def product(stage: Stage) -> None:
    stage["x"] * stage["x"]  # type: ignore[operator]


def data_in_a_cone(stage: Stage) -> None:
    stage.cone("flow", stage["x"], stage["x"], stage["price"])


def data_in_a_disc(stage: Stage) -> None:
    stage.disc("rating", 1.0, stage["x"] + stage["price"])


def variable_as_a_bound(stage: Stage) -> None:
    stage.var("y", ["a", "b"], 0.0, stage["x"])


def variable_as_a_price(stage: Stage) -> None:
    stage.cost("x", stage["x"], stage["x"])


def data_times_data(stage: Stage) -> None:
    stage.cost("x", stage["price"], stage["price"])


def too_few_prices(stage: Stage) -> None:
    stage.cost("x", stage["x"], stage["price"][[0]])


def unlike_lengths(stage: Stage) -> None:
    stage.cone("flow", stage["x"], stage["x"], stage["x"][[0]])


def unlike_rows(stage: Stage) -> None:
    stage.eq("row", stage["x"], stage.var("y", ["a", "b", "c"]))


@pytest.mark.parametrize(
    "mistake",
    [
        twice,
        product,
        data_in_a_cone,
        data_in_a_disc,
        variable_as_a_bound,
        variable_as_a_price,
        data_times_data,
        too_few_prices,
        unlike_lengths,
        unlike_rows,
    ],
    ids=lambda mistake: mistake.__name__,
)
def test_what_would_put_data_into_the_matrix_or_makes_no_sense_is_refused(
    mistake: Callable[[Stage], None],
) -> None:
    stage = Stage(1.0)
    stage.var("x", ["a", "b"])
    stage.data("price", ["a", "b"])
    with pytest.raises((ValueError, TypeError)):
        mistake(stage)


def tree(**changes: object) -> Tree:
    given: dict = {
        "parent": np.array([-1, 0, 0]),
        "probability": np.array([1.0, 0.4, 0.6]),
        "stage": np.zeros(3, np.intp),
        "labels": ("now", "low", "high"),
    }
    return Tree(**{**given, **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {"probability": np.array([1.0, 0.4, 0.4])},
        {"probability": np.array([1.0, 1.4, -0.4])},
        {"probability": np.array([0.5, 0.4, 0.6])},
        {"labels": ("now", "later", "later")},
        {"labels": ("now", "later")},
    ],
)
def test_a_tree_that_is_none_is_refused(changes: dict[str, object]) -> None:
    assert tree().leaves.tolist() == [1, 2]
    with pytest.raises(ValueError, match=r"node|probability"):
        tree(**changes)


@pytest.mark.parametrize("parent", [[-1, 2, 0], [-1, 1, 0], [-2, 0, 0]])
def test_a_node_comes_after_its_parent(parent: list[int]) -> None:
    with pytest.raises(ValueError, match="must come after its parent, a root has -1"):
        tree(parent=np.array(parent))


def test_a_state_has_its_unit_at_the_start_of_a_step_and_at_its_end() -> None:
    stage = Stage(0.5)
    stage.state("left", ["a"], 0.5, 4.0, unit="h", about="hours left")
    told = [(block.name, block.unit, block.about, block.kind) for block in stage.variables]
    assert told == [("left.now", "h", "hours left", "now"), ("left", "h", "hours left", "variable")]


def test_a_stage_without_variables_is_a_program_without_costs() -> None:
    problem = unroll([Stage(0.25)], Tree.chain(["now", "then"]))
    assert stage_form(Stage(0.25)).n_columns == 0
    assert problem.a.shape[0] == 0


def test_several_roots_share_the_start() -> None:
    roots = tree(parent=np.array([-1, -1, -1]), probability=np.array([0.2, 0.3, 0.5]))
    assert roots.leaves.tolist() == [0, 1, 2]


def test_stages_of_a_tree_have_the_same_states() -> None:
    one, other = Stage(1.0), Stage(0.5)
    one.state("energy", ["a"], 0.0, 1.0, unit="MWh")
    other.state("energy", ["b"], 0.0, 1.0, unit="MWh")
    both = Tree(np.array([-1, 0]), np.ones(2), np.array([0, 1]), ("now", "then"))
    with pytest.raises(ValueError, match="same states"):
        unroll([one, other], both)


def test_data_that_is_missing_or_no_number_is_called_by_its_name() -> None:
    stage = Stage(1.0)
    stage.var("x", ["a"], 0.0, stage.data("cap", ["a"]))
    problem = unroll([stage], Tree.chain(["now"]))
    with pytest.raises(KeyError, match="cap"):
        problem.vectors({}, {})
    with pytest.raises(ValueError, match="cap"):
        problem.vectors({"cap": [np.nan]}, {})


def test_a_cone_that_is_open_is_measured_by_what_flows() -> None:
    """3 * 5 for 6^2, and 0.5 * 4 for 0.3^2 + 0.4^2: shares of 1 + the squares."""
    stage = Stage(0.5)
    u, v, p, q = (stage.var(name, ["a", "b"]) for name in "uvpq")
    stage.cone("flow", u, v, p, q)
    (cone,) = stage.structures
    values = np.array([[3.0, 0.5], [5.0, 4.0], [6.0, 0.3], [0.0, 0.4]])
    assert cone.violation(list(values), ()).tolist() == pytest.approx([21.0 / 37.0, 1.75 / 1.25])
