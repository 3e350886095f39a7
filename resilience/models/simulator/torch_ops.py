"""The operations of the simulator on torch tensors; gradients pass through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.tolerances import POWER_TOLERANCE_MW

if TYPE_CHECKING:
    import torch

SPARSE_FROM_ENTRIES = 100_000  # entries, zeros included, from which torch gets a matrix sparse


@dataclass(frozen=True)
class TorchOps:
    """The same on torch tensors; gradients pass through.

    Attributes:
        dtype: number type.
        device: where the tensors are.
    """

    dtype: torch.dtype
    device: torch.device

    def array(self, value: Floats) -> torch.Tensor:
        """A constant, of the type and on the device of the state."""
        import torch

        return torch.as_tensor(value, dtype=self.dtype, device=self.device)

    def matrix(self, value: sp.csr_array) -> torch.Tensor:
        """A constant matrix."""
        import torch

        if value.shape[0] * value.shape[1] < SPARSE_FROM_ENTRIES:
            return self.array(value.toarray())
        entries = value.tocoo()
        return torch.sparse_coo_tensor(
            torch.as_tensor(np.stack([entries.row, entries.col])),
            torch.as_tensor(entries.data),
            value.shape,
            dtype=self.dtype,
            device=self.device,
            check_invariants=True,
        ).coalesce()

    @staticmethod
    def minimum(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """The smaller value at every place."""
        return x.minimum(y)

    @staticmethod
    def maximum(x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """The larger value at every place."""
        return x.maximum(y)

    @staticmethod
    def where(condition: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Takes x where the condition holds, y elsewhere."""
        return x.where(condition, y)

    @staticmethod
    def joined(arrays: Sequence[torch.Tensor]) -> torch.Tensor:
        """Tensors one below the other."""
        import torch

        return torch.cat(list(arrays))

    @staticmethod
    def positive(x: torch.Tensor) -> torch.Tensor:
        """max(x, 0)."""
        return x.clamp(min=0.0)

    @staticmethod
    def at_least(x: torch.Tensor, number: float) -> torch.Tensor:
        """max(x, number)."""
        return x.clamp(min=number)

    @staticmethod
    def above(x: torch.Tensor) -> torch.Tensor:
        """max(x, 0), without a gradient where x is 0."""
        return x.relu()

    @staticmethod
    def positive_up_to(x: torch.Tensor, limit: torch.Tensor) -> torch.Tensor:
        """min(max(x, 0), limit), as wide as x. The gradient is that of x up to the limit itself,
        and none where there is nothing to give, rounding aside: `minimum` would halve it between
        equals.
        """
        import torch

        if not (x.requires_grad or limit.requires_grad):
            return x.clamp(min=0.0).minimum(limit)
        moves = x + limit > POWER_TOLERANCE_MW
        return torch.clamp(x * moves, limit.new_zeros(()), limit)

    @staticmethod
    def within(x: torch.Tensor, low: torch.Tensor, high: torch.Tensor) -> torch.Tensor:
        """max(min(x, high), low); the gradient is that of x up to the limits themselves."""
        return x.clamp(low, high)

    @staticmethod
    def clipped(x: torch.Tensor, *limits: torch.Tensor) -> torch.Tensor:
        """max(min(x, *limits), 0)."""
        for limit in limits:
            x = x.minimum(limit)
        return x.clamp(min=0.0)

    @staticmethod
    def scaled_difference(x: torch.Tensor, y: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
        """(x - y) scale, as wide as x - y."""
        return (x - y) * scale

    @staticmethod
    def weighted_sum(
        a: torch.Tensor, x: torch.Tensor, b: torch.Tensor, y: torch.Tensor, offset: torch.Tensor
    ) -> torch.Tensor:
        """(a x + offset) + b y, as wide as x."""
        return offset.addcmul(a, x).addcmul(b, y)

    @staticmethod
    def scaled_rows(
        x: torch.Tensor, index: Ints, scale: torch.Tensor, offset: torch.Tensor
    ) -> torch.Tensor:
        """x[index] scale + offset, as wide as x."""
        return x[index] * scale + offset

    @staticmethod
    def stacked(arrays: Sequence[torch.Tensor]) -> torch.Tensor:
        """Tensors of one shape along a new first axis."""
        import torch

        return torch.stack(list(arrays))

    @staticmethod
    def cumulated(x: torch.Tensor) -> torch.Tensor:
        """(n + 1, ...) sums of the first 0, 1, ..., n along the first axis."""
        import torch

        return torch.cat([x.new_zeros((1, *x.shape[1:])), x.cumsum(0)])

    @staticmethod
    def priced(prices: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        """(batch,) sums of x (tiers, buses, batch), each tier at its price."""
        return (prices[:, None] * x).sum((0, 1))

    @staticmethod
    def priced_above(prices: torch.Tensor, x: torch.Tensor, levels: torch.Tensor) -> torch.Tensor:
        """(batch,) sums of what x is above levels."""
        return (prices[:, None] * (x - levels).clamp(min=0.0)).sum((0, 1))

    @staticmethod
    def sums(x: torch.Tensor, island: torch.Tensor, n: int) -> torch.Tensor:
        """(..., n, batch) sums of the rows of x over islands."""
        if n == 1:
            return x.sum(-2, keepdim=True)
        zeros = x.new_zeros((*x.shape[:-2], n, x.shape[-1]))
        return zeros.scatter_add(-2, island.expand(x.shape), x)

    @staticmethod
    def at_islands(x: torch.Tensor, island: torch.Tensor) -> torch.Tensor:
        """(..., rows, batch) what x is in the row of each row's island."""
        return x if x.shape[-2] == 1 else x.gather(-2, island.expand(*x.shape[:-2], -1, -1))

    @staticmethod
    def wide(x: torch.Tensor, batch: int) -> torch.Tensor:
        """The tensor (..., 1) or (..., batch) as (..., batch)."""
        return x.expand(*x.shape[:-1], batch)

    @staticmethod
    def rows(x: torch.Tensor, index: Ints) -> torch.Tensor:
        """Some rows of x."""
        return x[index]

    def index(self, places: Ints) -> torch.Tensor:
        """Places along an axis, on the device."""
        import torch

        return torch.as_tensor(places, device=self.device)

    @staticmethod
    def beside(arrays: Sequence[torch.Tensor]) -> torch.Tensor:
        """Tensors one beside the other, along the batch."""
        import torch

        return torch.cat(list(arrays), dim=-1)

    def may_exceed(self, x: torch.Tensor, threshold: float) -> bool:
        """Whether any abs(x) exceeds the threshold; true on a device, which looking would stop."""
        if self.device.type != "cpu":
            return True
        return bool(x.numel() and x.detach().abs().max() > threshold)

    @staticmethod
    def as_numpy(x: torch.Tensor) -> np.ndarray:
        """The tensor as a NumPy array, without its gradient."""
        return x.detach().cpu().numpy()
