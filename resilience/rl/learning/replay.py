"""What was done and what came of it, by index into the episodes in which it was done.

A row is a slot of an episode. What was seen in it lies in the episode's tape, which the ring holds
once and from which it gathers; of what was done, it keeps the energy, the output and the reward.
Tapes come from their numbers, so that a ring on disk is a few arrays and a list of numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch

from resilience.arrays import Ints
from resilience.dispatch.anchors import Needs
from resilience.models.simulator.plant import StorageSlot
from resilience.rl.ground.bands import BandSlot
from resilience.rl.ground.env import BatchEnv
from resilience.rl.ground.tape import Tape

EMPTY = -1  # in place of a tape's number


@dataclass(frozen=True)
class Situations:
    """Some slots of some episodes, as the band and the networks need them.

    Attributes:
        observed: (n, numbers) observations, storage included.
        energy: (units, n) MWh.
        slot: what the band needs to know of the slots.
    """

    observed: torch.Tensor
    energy: torch.Tensor
    slot: BandSlot


@dataclass(frozen=True)
class Transitions:
    """A sample of what was done.

    Attributes:
        now: where.
        output: (n, units) what was done, in [-1, 1].
        rewards: (heads, n) discounted sum of the rewards until `later`, $.
        later: where it led to, some slots on; of episodes that are over by then, anything.
        discount: (n,) what a value of `later` is multiplied by; 0 where the episode is over.
    """

    now: Situations
    output: torch.Tensor
    rewards: torch.Tensor
    later: Situations
    discount: torch.Tensor


class ReplayRing:
    """A ring of tapes, each with what was done in it.

    Args:
        env: the training ground.
        tapes: how many are kept.
        episodes: in each.
        heads: rewards of a slot, one for all or one per agent.
    """

    def __init__(self, env: BatchEnv, tapes: int, episodes: int, heads: int = 1) -> None:
        self.env, self.episodes, self.heads = env, episodes, heads
        self.numbers = np.full(tapes, EMPTY)
        self.place = self.played = self._per_tape = 0
        self._done: dict[str, torch.Tensor] = {}
        self._seen: dict[str, torch.Tensor] = {}

    def open(self, number: int) -> Tape:
        """Tape `number`, in the place of the oldest; what is done from now on belongs to it."""
        if self.numbers[0] != EMPTY:
            self.place = (self.place + 1) % len(self.numbers)
        tape = self.env.draw(self.episodes, number)
        self._put(self.place, number, tape)
        self.played = 0
        return tape

    def add(self, energy: torch.Tensor, output: torch.Tensor, reward: torch.Tensor) -> None:
        """The next slot of the open tape: energies (units, n) before it, outputs (n, units),
        rewards (heads, n).
        """
        first = self.place * self._per_tape + self.played * self.episodes
        rows = slice(first, first + self.episodes)
        self._done["energy"][:, rows] = energy
        self._done["output"][rows] = output
        self._done["reward"][:, rows] = reward
        self.played += 1

    def usable(self, steps: int) -> int:
        """Rows whose next `steps` slots have been played, or whose episode has been played out."""
        is_over = self.played * self.episodes == self._per_tape
        in_open = self.played if is_over else max(self.played - steps, 0)
        others = int((self.numbers != EMPTY).sum()) - 1
        return others * self._per_tape + in_open * self.episodes

    def rows(self, number: Ints, steps: int) -> Ints:
        """Rows by their number among the usable ones, oldest first."""
        assert number.max(initial=0) < self.usable(steps)
        filled = int((self.numbers != EMPTY).sum())
        first = (self.place + 1) % filled * self._per_tape
        return (first + number) % (filled * self._per_tape)

    def sample(self, n: int, rng: np.random.Generator, steps: int, discount: float) -> Transitions:
        """n rows at random, with replacement, each with what came within `steps` slots."""
        rows = self.rows(rng.integers(self.usable(steps), size=n), steps)
        return self.transitions(rows, steps, discount)

    def transitions(self, rows: Ints, steps: int, discount: float) -> Transitions:
        """These rows, with what came within `steps` slots."""
        slots = self._per_tape // self.episodes
        slots_left = slots - rows % self._per_tape // self.episodes
        total: torch.Tensor | float = 0.0
        for k in range(steps):
            counts = self.env.tensor(np.where(k < slots_left, discount**k, 0.0))
            later = rows + np.minimum(k, slots_left - 1) * self.episodes
            total = total + counts * self._done["reward"][:, self._index(later)]
        is_over = steps >= slots_left
        later = rows + np.where(is_over, 0, steps) * self.episodes
        return Transitions(
            self.situations(rows),
            self._done["output"][self._index(rows)],
            torch.as_tensor(total),
            self.situations(later),
            self.env.tensor(np.where(is_over, 0.0, discount**steps)),
        )

    def situations(self, rows: Ints) -> Situations:
        """The situations of rows."""
        index, observed = self._index(rows), self._seen
        energy = self._done["energy"][:, index]
        needs = None
        if "surplus" in observed:
            needs = Needs(*(observed[name][:, index] for name in Needs._fields))
        storage = StorageSlot(observed["power_limits"][..., index], observed["island"][:, index])
        return Situations(
            self.env.with_storage(energy, observed["observed"][index]),
            energy,
            BandSlot(storage, needs),
        )

    def state(self) -> dict[str, torch.Tensor]:
        """What was done, and the numbers of the tapes; tapes are drawn anew."""
        place = torch.tensor([self.place, self.played])
        return {"numbers": torch.as_tensor(self.numbers), "place": place, **self._done}

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Goes on from what `state` gave."""
        self.numbers[:] = EMPTY
        for place, number in enumerate(state["numbers"].tolist()):
            if number != EMPTY:
                self._put(place, number, self.env.draw(self.episodes, number))
        self.place, self.played = state["place"].tolist()
        self._done = {n: v.clone() for n, v in state.items() if n not in ("numbers", "place")}

    def _index(self, rows: Ints) -> torch.Tensor:
        return torch.as_tensor(rows, device=self.env.device)

    def _put(self, place: int, number: int, tape: Tape) -> None:
        """A tape's arrays with one row per slot and episode, slot by slot."""
        self._per_tape = tape.slots * tape.n
        first = place * self._per_tape
        for name, values in _flat(tape).items():
            axis = 0 if name == "observed" else values.ndim - 1
            storage = self._seen.setdefault(name, self._room(values, axis))
            storage.narrow(axis, first, self._per_tape).copy_(values)
        if not self._done:
            units, room = self.env.units, len(self.numbers) * self._per_tape
            shapes = {
                "energy": (units, room),
                "output": (room, units),
                "reward": (self.heads, room),
            }
            like = tape.observed
            self._done = {name: like.new_zeros(shape) for name, shape in shapes.items()}
        self.numbers[place] = number

    def _room(self, values: torch.Tensor, axis: int) -> torch.Tensor:
        shape = list(values.shape)
        shape[axis] = len(self.numbers) * self._per_tape
        return torch.zeros(shape, dtype=values.dtype, device=values.device)


def _flat(tape: Tape) -> dict[str, torch.Tensor]:
    """What a tape shows, with its slots and episodes along the last axis, of observations along the
    first.
    """
    slots = [now.band for now in tape.plain]
    flat = {
        "power_limits": np.concatenate([slot.storage.power_limits for slot in slots], -1),
        "island": np.concatenate([slot.storage.island for slot in slots], -1),
    }
    needs = [slot.needs for slot in slots if slot.needs is not None]
    if needs:
        wide = [[np.broadcast_to(x, (len(x), tape.n)) for x in slot_needs] for slot_needs in needs]
        parts = zip(Needs._fields, zip(*wide, strict=True), strict=True)
        flat |= {name: np.concatenate(values, -1) for name, values in parts}
    moved = {name: tape.tensor(values) for name, values in flat.items()}
    return {"observed": tape.observed.flatten(0, 1), **moved}
