"""Every array operation gives the same on NumPy and on torch, and changes no argument on either."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from resilience.models.simulator import torch_ops
from resilience.models.simulator.arrays import Array, ArrayOps, array_ops

torch = pytest.importorskip("torch", reason="the extra `learn` is not installed")

RNG = np.random.default_rng(0)
X, Y, Z, W = (RNG.normal(size=(4, 6)) for _ in range(4))
COLUMN = RNG.normal(size=(4, 1))
LAYERS = RNG.normal(size=(3, 4, 6))
ISLAND = RNG.integers(0, 4, (4, 6))
ONE_ISLAND = np.zeros((1, 6), int)
MATRIX = sp.csr_array(np.round(RNG.normal(size=(5, 4))))

Operation = Callable[..., Array]
OPERATIONS: dict[str, tuple[Operation, tuple[np.ndarray, ...]]] = {
    "array": (lambda ops, x: ops.array(COLUMN) + x, (X,)),
    "matrix": (lambda ops, x: ops.matrix(MATRIX) @ x, (X,)),
    "minimum": (lambda ops, x, y: ops.minimum(x, y), (X, Y)),
    "maximum": (lambda ops, x, y: ops.maximum(x, y), (X, Y)),
    "where": (lambda ops, x, y: ops.where(x > y, x, y), (X, Y)),
    "joined": (lambda ops, x, y: ops.joined([x, y]), (X, Y)),
    "positive": (lambda ops, x: ops.positive(x), (X,)),
    "positive_up_to": (lambda ops, x, y: ops.positive_up_to(x, y), (X, COLUMN)),
    "above": (lambda ops, x: ops.above(x), (X,)),
    "within": (lambda ops, x, y: ops.within(x, y, y + 0.3), (X, Y)),
    "at_least": (lambda ops, x: ops.at_least(x, 0.2), (X,)),
    "stacked": (lambda ops, x, y: ops.stacked([x, y]), (X, Y)),
    "cumulated": (lambda ops, x: ops.cumulated(x), (LAYERS,)),
    "priced": (lambda ops, x, prices: ops.priced(prices, x), (LAYERS, COLUMN[:3])),
    "priced_above": (
        lambda ops, x, prices, levels: ops.priced_above(prices, x, levels),
        (X, COLUMN[:3], LAYERS),
    ),
    "sums": (lambda ops, x, island: ops.sums(x, island, 5), (LAYERS, ISLAND)),
    "at_islands": (lambda ops, x, island: ops.at_islands(x, island), (LAYERS, ISLAND[[3, 1]])),
    "clipped": (lambda ops, x, y, z: ops.clipped(x, y, z), (X, Y, COLUMN)),
    "scaled_difference": (lambda ops, x, y, z: ops.scaled_difference(x, y, z), (X, COLUMN, Y)),
    "weighted_sum": (lambda ops, *args: ops.weighted_sum(*args), (COLUMN, X, Y, Z, W)),
    "scaled_rows": (
        lambda ops, x, y, z: ops.scaled_rows(x, np.array([2, 0, 2, 1]), y, z),
        (X, COLUMN, Z),
    ),
    "wide": (lambda ops, x: ops.wide(x, 6), (COLUMN,)),
    "index": (lambda ops, x: x[:, ops.index(np.array([4, 1]))], (X,)),
    "beside": (lambda ops, x, y: ops.beside([x, y]), (X, COLUMN)),
    "rows": (lambda ops, x: ops.rows(x, np.array([2, 0, 2])), (X,)),
    "may_exceed": (lambda ops, x: x + float(ops.may_exceed(x, 0.1)), (X,)),
    "as_numpy": (lambda ops, x: x + ops.array(ops.as_numpy(x)), (X,)),
}
OPERATIONS["wide, as it is"] = (lambda ops, x: ops.wide(x, 6), (X,))
OPERATIONS["clipped by one"] = (lambda ops, x, y: ops.clipped(x, y), (COLUMN, X))
OPERATIONS["priced by member"] = (OPERATIONS["priced"][0], (LAYERS, X[:3]))
OPERATIONS["one island, summed"] = (
    lambda ops, x, island: ops.sums(x, island, 1),
    (X, np.zeros((4, 6), int)),
)
OPERATIONS["one island, spread"] = (OPERATIONS["at_islands"][0], (X[:1], ONE_ISLAND))


def on(library: str, values: tuple[np.ndarray, ...]) -> list[Any]:
    copies = [value.copy() for value in values]
    return copies if library == "numpy" else [torch.as_tensor(copy) for copy in copies]


def test_every_operation_is_tried() -> None:
    assert {name for name in vars(ArrayOps) if not name.startswith("_")} <= set(OPERATIONS)


@pytest.mark.parametrize("name", OPERATIONS)
def test_both_libraries_give_the_same_and_change_no_argument(name: str) -> None:
    operation, values = OPERATIONS[name]
    results = {}
    for library in ("numpy", "torch"):
        arguments = on(library, values)
        ops = array_ops(arguments[0])
        results[library] = ops.as_numpy(operation(ops, *arguments)).copy()
        for argument, value in zip(arguments, values, strict=True):
            np.testing.assert_array_equal(np.asarray(argument), value)
    assert results["numpy"].shape == results["torch"].shape
    np.testing.assert_allclose(results["numpy"], results["torch"], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("name", [name for name in OPERATIONS if name != "as_numpy"])
def test_gradients_pass_through(name: str) -> None:
    operation, values = OPERATIONS[name]
    arguments = [x.requires_grad_() if x.is_floating_point() else x for x in on("torch", values)]
    operation(array_ops(arguments[0]), *arguments).sum().backward()
    assert arguments[0].grad is not None


def test_a_large_matrix_is_sparse_and_gives_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch_ops, "SPARSE_FROM_ENTRIES", 1)
    x = torch.as_tensor(X)
    matrix = array_ops(x).matrix(MATRIX)
    assert matrix.is_sparse
    np.testing.assert_allclose((matrix @ x).numpy(), MATRIX @ X, atol=1e-14)


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_it_is_looked_up_whether_anything_exceeds(library: str) -> None:
    (x,) = on(library, (X,))
    ops = array_ops(x)
    assert not ops.may_exceed(x, np.abs(X).max() + 1e-9)
    assert ops.may_exceed(x, np.abs(X).max() - 1e-9)
    assert ops.may_exceed(-x, np.abs(X).max() - 1e-9)
    assert not ops.may_exceed(x[:0], 0.1)


def test_no_device_is_stopped_to_look() -> None:
    device = torch.device("meta")
    assert array_ops(torch.empty(3, device=device)).may_exceed(torch.empty(3, device=device), 0.1)


def test_the_gradient_of_what_is_above_zero_is_none_and_of_what_is_within_all_on_the_edge() -> None:
    x = torch.tensor([-0.3, 0.0, 0.4], requires_grad=True)
    array_ops(x).above(x).sum().backward()
    assert x.grad is not None
    assert x.grad.tolist() == [0.0, 0.0, 1.0]
    y = torch.tensor([-0.3, 0.2, 0.4, 0.9, 1.1], requires_grad=True)
    array_ops(y).within(y, torch.full((5,), 0.2), torch.full((5,), 0.9)).sum().backward()
    assert y.grad is not None
    assert y.grad.tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]
