r"""A bound for everybody without foreknowledge: a clairvoyant who pays for what it foresees.

Whoever knows the future keeps energy where it will be needed. It pays for that by penalties,

$$ \pi = \sum_{t, s, k} a_{skt} \left(d_{k,t+1} - E[d_{k,t+1} \mid H_t]\right) x_{st}, $$

where $d_{k,t+1}$ is whether line $k$ is down in the next slot, $H_t$ all that an operator has seen
by slot $t$, and $x_{st}$ what storage or tank $s$ holds at its end. Whoever decides $x_{st}$ by
$H_t$ alone pays nothing on average, whatever the slopes $a$ are, since the conditional mean is that
of the process and no sample's. So the mean over storms of the penalised optimum,

$$ E\big[\min_x \{C(x) + \pi(x)\}\big], $$

is a lower bound on the mean cost of every non-anticipative policy (Brown, Smith & Sun 2010,
Operations Research 58(4), "Information relaxations and duality in stochastic dynamic programs"). It
is as tight as the slopes are good: best is what a MWh is worth more if the line is down than if it
is up. They begin as that difference of the clairvoyant's own multipliers, scaled, and are improved
by steps of the subgradient $E[(d - E[d \mid H])\, (x - x')]$, where $x'$ is held by a rule that
foresees nothing and so takes noise out and leaves the mean. All of it is done on storms of its own:
a bound that was tuned on the storms it is stated for would be too high.

What a policy costs and its own penalties never lie below the penalised optimum of the same episode.
Their difference has the mean of the gap and little of its noise, so that is what is reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats
from resilience.errors import CertificateError, UsageError
from resilience.evaluation.bounds.penalties import PenalisedProgram
from resilience.fragility.draw import sample_case
from resilience.fragility.outages.blackout import case_blackout
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.program import gate
from resilience.progress import meter
from resilience.simulation.setting import CASE
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World

TUNING_STORMS = 16
STEPS = 25
SCALES = (0.0, 0.5, 1.0, 2.0)
"""Of the first slopes: with 0 the bound is the clairvoyant's."""
STRIDE = 0.15
"""Of a step, in the greatest slope of its state."""
JUDGED_EVERY = 5
"""Steps after which slopes are judged on storms that they were not learned on."""
SHORTER = 0.2
"""Times the stride, from the best slopes on, where others were none better."""


@dataclass(frozen=True)
class DualBound:
    """What nobody without foreknowledge stays below on average.

    Attributes:
        optimum: (episodes,) $, the penalised optimum of each; only its mean is a bound.
        penalty: method to (episodes,) $, what its own decisions pay; nothing on average.
        probability: (episodes,).
    """

    optimum: Floats
    penalty: Mapping[str, Floats]
    probability: Floats

    def mean(self, objective: Mapping[str, Floats]) -> float:
        """The bound as far as these episodes show, $ an episode.

        The mean of the penalised optimum, less what the cheapest method pays in the same episodes:
        that is nothing on average, and takes most of the noise out of it.

        Args:
            objective: method to (episodes,) $.
        """
        above = {name: self.over(name, objective[name]) for name in self.penalty}
        nearest = min(above, key=lambda name: above[name])
        return float(self.probability @ objective[nearest]) - above[nearest]

    def over(self, name: str, objective: Floats) -> float:
        """What a method costs above the bound, $ an episode, its penalties taken for noise."""
        return float(self.probability @ (objective + self.penalty[name] - self.optimum))

    def check(self, objective: Mapping[str, Floats], scale: float) -> None:
        """Refuses a method whose episode lies below its penalised optimum.

        Args:
            objective: method to (episodes,) $.
            scale: $ beside which rounding is nothing.

        Raises:
            CertificateError: one does, so that the bound or the method's cost is wrong.
        """
        for name, penalty in self.penalty.items():
            for cost, paid, optimum in zip(objective[name], penalty, self.optimum, strict=True):
                if cost + paid < optimum - gate.rounding(optimum, scale):
                    raise CertificateError(
                        f"{name!r} costs {cost:.9g} $ and pays {paid:.9g} $ of penalties, less "
                        f"than the penalised optimum, {optimum:.9g} $: {gate.FAULT}",
                        hint=gate.HINT,
                    )


def beyond_dual_bound(world: World) -> str:
    """Why a world has no such bound, in words; empty where it has one."""
    if world.believed != CASE or world.scenarios.seed is None:
        return "the storms are not drawn from the case's own process"
    if world.microgrid.case.fallible_units:
        return "units may fail, and what they do next depends on all lines together"
    if not hasattr(world.setting.belief(), "next_down"):
        return "what a storm on its track does next has no closed form"
    return "the state of charge is reset every midnight" if world.reset_daily else ""


def prove_dual_bound(
    world: World, trajectories: Mapping[str, Trajectory], seed: int = 0
) -> DualBound:
    """The bound over the storms of a world, and what every method pays there.

    Args:
        world: storms drawn from the case's own process.
        trajectories: method to what it did; none of them knows the future.
        seed: of the storms on which slopes are improved.

    Raises:
        UsageError: a world that has no such bound.
    """
    if reason := beyond_dual_bound(world):
        raise no_dual_bound(reason)
    learning, judging = _storms_to_tune_on(world, seed)
    slopes = _improved(learning, judging)
    program = PenalisedProgram(world)
    optimum = program.optimum(slopes)
    paid = {name: program.paid(slopes, done) for name, done in trajectories.items()}
    return DualBound(optimum, paid, world.scenarios.probability)


def no_dual_bound(reason: str) -> UsageError:
    """What to say of a world that has no such bound."""
    return UsageError(
        f"no dual bound: {reason}; allowed: a bell or a blackout, believed as it is",
        hint="the clairvoyant bound holds for any storms",
    )


def _storms_to_tune_on(world: World, seed: int) -> tuple[PenalisedProgram, PenalisedProgram]:
    """The same world with storms to improve slopes on, and with others to choose among them.

    Of a blackout both are all ends that there can be, with their probabilities.
    """
    case = world.microgrid.case
    if case.blackout is not None:
        program = PenalisedProgram(_elsewhere(world, case_blackout(case).every_end()))
        return program, program
    numbers = np.random.SeedSequence([seed, 2]).generate_state(2)
    learning, judging = (
        PenalisedProgram(_elsewhere(world, sample_case(case, TUNING_STORMS, int(number))))
        for number in numbers
    )
    return learning, judging


def _elsewhere(world: World, storms: Scenarios) -> World:
    """The same world with other storms, load and PV as the profiles say."""
    return World.build(
        world.microgrid, storms, end_value_per_mwh=world.end_value_per_mwh,
        known_centre=world.known_centre, recourse=world.recourse,
    )  # fmt: skip


def _improved(learning: PenalisedProgram, judging: PenalisedProgram) -> Floats:
    """Slopes: scaled first ones, then steps of the subgradient on storms to learn from, of which
    those are kept that other storms like best; there, none at all is one of the choices.
    """
    first = learning.first_slopes()
    best, best_value = np.zeros_like(first), -np.inf
    with meter("dual bound", len(SCALES) + STEPS) as progress:
        for scale in SCALES:
            value = judging.value(scale * first)
            if value > best_value:
                best, best_value = scale * first, value
            progress.advance(1)
        slopes, stride = best, STRIDE * np.abs(first).max(axis=(1, 2), keepdims=True)
        squared = np.zeros_like(first)
        for step in range(1, STEPS + 1):
            gradient = learning.gradient(slopes)
            squared += gradient**2  # AdaGrad: slots that are seldom surprising move as far
            slopes = slopes + stride * gradient / np.sqrt(np.where(squared > 0.0, squared, 1.0))
            progress.advance(1)
            if step % JUDGED_EVERY:
                continue
            value = judging.value(slopes)
            if value > best_value:
                best, best_value = slopes, value
            else:
                slopes, stride, squared = best, SHORTER * stride, np.zeros_like(first)
    return best
