"""The few array operations of the simulator, for NumPy and for torch (differentiable)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

Array = Any
Map = tuple[np.ndarray, sp.csr_array]  # constant (n, 1) and coefficients (n, n_data)


class NumPy:
    """Operations on numpy arrays (n, batch)."""

    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)
    where = staticmethod(np.where)
    joined = staticmethod(np.concatenate)

    @staticmethod
    def array(value: np.ndarray) -> np.ndarray:
        """A constant."""
        return value

    @staticmethod
    def positive(x: np.ndarray) -> np.ndarray:
        """max(x, 0)."""
        found: np.ndarray = np.maximum(x, 0.0)
        return found

    @staticmethod
    def affine(form: Map, data: np.ndarray) -> np.ndarray:
        """constant + coefficients @ data, (n, batch)."""
        constant, coefficients = form
        if not coefficients.nnz:
            return constant
        found: np.ndarray = constant + coefficients @ data
        return found

    @staticmethod
    def mapped(matrix: sp.csr_array, x: np.ndarray) -> np.ndarray:
        """A constant matrix times x."""
        found: np.ndarray = matrix @ x
        return found

    @staticmethod
    def segment(x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(buses, batch) sums over islands, in the row of the island's number."""
        n, batch = x.shape
        if n == 1:
            return x
        at = (island * batch + np.arange(batch)).ravel()
        return np.bincount(at, x.ravel(), n * batch).reshape(n, batch)

    @staticmethod
    def spread(x: np.ndarray, island: np.ndarray) -> np.ndarray:
        """(buses, batch) the island's value at each of its buses."""
        return x if len(x) == 1 else np.take_along_axis(x, island, axis=0)


class Torch:
    """The same on torch tensors; gradients pass through."""

    def __init__(self, like: Any) -> None:
        import torch

        self.torch, self.like = torch, like
        self.minimum, self.maximum, self.where = torch.minimum, torch.maximum, torch.where
        self.joined = torch.cat

    def array(self, value: np.ndarray) -> Any:
        """A constant, of the type and on the device of the state."""
        return self.torch.as_tensor(value, dtype=self.like.dtype, device=self.like.device)

    @staticmethod
    def positive(x: Any) -> Any:
        """max(x, 0)."""
        return x.clamp(min=0.0)

    def affine(self, form: Map, data: Any) -> Any:
        """constant + coefficients @ data, (n, batch)."""
        constant, coefficients = form
        return self.array(constant) + self.array(coefficients.toarray()) @ data

    def mapped(self, matrix: sp.csr_array, x: Any) -> Any:
        """A constant matrix times x."""
        return self.array(matrix.toarray()) @ x

    def segment(self, x: Any, island: Any) -> Any:
        """(buses, batch) sums over islands, in the row of the island's number."""
        return x if len(x) == 1 else self.torch.zeros_like(x).scatter_add(0, island, x)

    @staticmethod
    def spread(x: Any, island: Any) -> Any:
        """(buses, batch) the island's value at each of its buses."""
        return x if len(x) == 1 else x.gather(0, island)


def namespace(x: Array) -> Any:
    """The operations for the kind of array that x is."""
    return NumPy if isinstance(x, np.ndarray) else Torch(x)
