"""The two-stage program of what to build: the choice first, then every storm for itself.

The root of the tree is the choice, with its budget; behind it every storm is a chain of slots, as
whoever operates the feeder knows it. So what a choice is worth is what it saves an operator who
meets the storm in the best way there is: it is at most what it saves anybody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.models.algebra import Affine
from resilience.models.case_program import line_up_before, terminal_cuts
from resilience.models.components import Sited, Strengthened
from resilience.models.components.sited import BUILT
from resilience.models.language.decision import decision
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.program.risk import Risk
from resilience.planning.hardening.draws import StrengthDraws, StrengthOption
from resilience.planning.hardening.sites import Built, UnitOption, outputs, sited_of, with_built
from resilience.planning.two_stage.two_stage import IN, TwoStage
from resilience.simulation.world import microgrid_with_fallible_lines

BUDGET = "plan.budget"
STRENGTH = "line.strength"
Option = StrengthOption | Built


@dataclass(frozen=True)
class HardeningProgram:
    """What to build against some storms.

    Attributes:
        microgrid: the microgrid, its lines open to choice.
        two_stage: the choice, and the storms behind it, each kept once.
        options: lines to strengthen, then units to build, then ties.
        price: (options,) $ in the objective for each that is built.
        index: (scenarios,) which of the program's storms each is.
    """

    microgrid: Microgrid
    two_stage: TwoStage
    options: tuple[Option, ...]
    price: Floats
    index: Ints

    @property
    def design_columns(self) -> Ints:
        """(options,) columns of the trunk."""
        initial = self.two_stage.first.initial
        return np.concatenate([initial[name] for name in (STRENGTH, BUILT) if name in initial])

    @property
    def cost(self) -> Floats:
        """(options,) $ to build each."""
        return np.array([option.cost for option in self.options])

    def data_with(self, budget: float) -> dict[str, Floats]:
        """Data of the trunk with another budget, $."""
        return self.two_stage.first_data | _limit(self.options, budget)

    def trunk_with(self, chosen: Bools) -> Floats:
        """The trunk in which the chosen options (options,) are built."""
        first, z = self.two_stage.first, np.zeros(self.two_stage.first.n_columns)
        for name, columns in first.initial.items():
            if name not in (STRENGTH, BUILT):
                z[columns] = self.two_stage.x0[name]
                z[first.columns(name)[:, 0]] = self.two_stage.x0[name]
        z[self.design_columns] = chosen
        return z


def hardening_program(
    case: Case,
    options: Sequence[Option],
    draws: StrengthDraws,
    budget: float,
    *,
    price: Floats | None = None,
    risk: Risk | None = None,
    physics: Physics = "copperplate",
) -> HardeningProgram:
    """The program.

    Args:
        case: the case.
        options: lines in the order of the network, then units, then ties, see `options_of`.
        draws: the storms, options of lines as here.
        budget: $ that may be spent.
        price: (options,) $ in the objective for each that is built; nothing if omitted.
        risk: the objective over storms, expected cost if omitted.
        physics: of every storm.
    """
    lines = [option for option in options if isinstance(option, StrengthOption)]
    others = [option for option in options if not isinstance(option, StrengthOption)]
    units = [option for option in others if isinstance(option, UnitOption)]
    price = np.zeros(len(options)) if price is None else price
    case = with_built(case, others, undecided=True)
    microgrid = microgrid_with_fallible_lines(case, draws.scenarios, physics)
    strengthened = _strengthened(lines, price[: len(lines)])
    bare = draws.scenarios.status(microgrid.case.elements)
    statuses = _Statuses.drawn(microgrid, strengthened, bare, ~draws.strong)
    distinct, weight, index = statuses.distinct(draws.scenarios.probability)
    tree, slot = _tree(case, weight)
    nodes = distinct.nodes()
    strengthened = replace(strengthened, bare=nodes.bare_of_lines, strong=nodes.strong)
    sited = sited_of(others, price[len(lines) :])
    microgrid = replace(microgrid, strengthened=strengthened if lines else None, sited=sited)
    situation = microgrid.situation(
        nodes.up,
        lambda name: case.profile(name)[slot],
        before=line_up_before(nodes.up, tree),
        is_last=slot == case.slots - 1,
    )
    stages, kind = _stages(microgrid, units)
    tree = replace(tree, stage=np.append(0, 1 + kind[slot[1:]]))
    first = _choice(microgrid, stages[0], options)
    data = microgrid.data(situation) | _limit(options, budget)
    if "generator.bound" in data:
        data["generator.bound"] = np.zeros_like(data["generator.bound"])
    two_stage = TwoStage(
        [first, *stages], tree, 1, data, microgrid.start(), terminal_cuts(microgrid), risk or Risk()
    )
    matters = np.zeros((len(weight), two_stage.first.n_states), bool)
    if lines:
        matters[:, two_stage.first.initial[STRENGTH]] = distinct.matters
    if others:
        matters[:, two_stage.first.initial[BUILT]] = True
    # With voltages a line that is up ties its ends to each other, which may cost something.
    falls = distinct.falls if physics == "copperplate" else None
    two_stage = replace(two_stage, matters=matters, falls=falls)
    return HardeningProgram(microgrid, two_stage, tuple(options), price, index)


def _limit(options: Sequence[Option], budget: float) -> dict[str, Floats]:
    """The datum of a budget, $: as much as everything costs where there is none."""
    return {BUDGET: np.array([[min(budget, sum(option.cost for option in options))]])}


def _strengthened(options: Sequence[StrengthOption], price: Floats) -> Strengthened:
    """The lines of options, (options,) $ for each, statuses to come."""
    lines = tuple(dict.fromkeys(option.line for option in options))
    return Strengthened(
        lines,
        tuple(option.label for option in options),
        np.array([lines.index(option.line) for option in options], np.intp),
        price,
    )


def _stages(microgrid: Microgrid, units: Sequence[UnitOption]) -> tuple[list[Stage], Ints]:
    """A stage for every slot unlike all others, and (slots,) the stage of each."""
    case, sited = microgrid.case, microgrid.sited
    peaks = microgrid.limit_profiles(case.profile, case.slots)
    begins = np.zeros((1, case.slots))
    begins[0, 0] = sited is not None
    rows = np.concatenate([peaks, outputs(case, units), begins])
    kinds, kind = np.unique(rows, axis=1, return_inverse=True)
    stages = []
    for column in kinds.T:
        peak, output = column[: len(peaks)], column[len(peaks) : -1]
        if sited is not None:
            of_slot = replace(sited, output=output, begins=bool(column[-1]))
            microgrid = replace(microgrid, sited=of_slot)
        stages.append(microgrid.stage(case.step_h, energy_known=True, may_spill=True, peak=peak))
    return stages, kind.ravel()


def _choice(microgrid: Microgrid, stage: Stage, options: Sequence[Option]) -> Stage:
    """The step before all storms, in which it is chosen what to build within the budget."""
    first, spent = decision(stage), []
    for name, component in ((STRENGTH, microgrid.strengthened), (BUILT, microgrid.sited)):
        if component is not None:
            component.choose(first)
            of_these = isinstance(component, Sited)
            costs = [o.cost for o in options if isinstance(o, StrengthOption) != of_these]
            spent.append((first[name] * np.array(costs)).sum())
    limit = first.data(BUDGET, ("all",), unit="$", about="what may be spent")
    total: Affine = spent[0] if len(spent) == 1 else spent[0] + spent[1]
    first.le(BUDGET, total, limit)
    return first


@dataclass(frozen=True)
class _Statuses:
    """Status of elements in every storm, (.., slots, storms), True: up.

    Attributes:
        up: (elements, ...) up with some option, or as it is.
        bare_of_lines: (lines, ...) as lines with options are without any.
        strong: (options, ...) with each option.
        bare_of_options: (options, ...) as the line of each option is without any.
    """

    up: Bools
    bare_of_lines: Bools
    strong: Bools
    bare_of_options: Bools

    @classmethod
    def drawn(
        cls, microgrid: Microgrid, strengthened: Strengthened, bare: Bools, strong: Bools
    ) -> _Statuses:
        rows = [microgrid.case.element(name) for name in strengthened.lines]
        up, line_of = bare.copy(), strengthened.line_of
        for option, line in enumerate(line_of):
            up[rows[line]] |= strong[option]
        return cls(up, bare[rows], strong, bare[rows][line_of])

    def distinct(self, probability: Floats) -> tuple[_Statuses, Floats, Ints]:
        """Every storm once, what each weighs, and (scenarios,) which one each scenario is."""
        together = np.concatenate([self.up, self.bare_of_lines, self.strong])
        path = np.packbits(~together.transpose(2, 1, 0).reshape(len(probability), -1), axis=1)
        _, first, index = np.unique(path, axis=0, return_index=True, return_inverse=True)
        weight: Floats = np.bincount(index.ravel(), probability, len(first)).astype(float)
        once = _Statuses(
            self.up[:, :, first],
            self.bare_of_lines[:, :, first],
            self.strong[:, :, first],
            self.bare_of_options[:, :, first],
        )
        return once, weight, index.ravel()

    @property
    def matters(self) -> Bools:
        """(storms, options) whether an option changes anything."""
        return (self.strong != self.bare_of_options).any(axis=1).T

    @property
    def falls(self) -> Bools:
        """(storms,) whether no option has its line down where it would be up without.

        A stronger line may fail later, and be mended later; nor do several options of one line
        have an order.
        """
        in_order = ~(self.bare_of_options & ~self.strong).any(axis=(0, 1))
        several = len(self.strong) > len(self.bare_of_lines)
        return np.asarray(in_order & (not several))

    def nodes(self) -> _Statuses:
        """The same, (.., nodes): the choice, in which all is up, then storm by storm."""

        def chained(status: Bools) -> Bools:
            lines, slots, storms = status.shape
            chain = status.transpose(0, 2, 1).reshape(lines, slots * storms)
            return np.concatenate([np.ones((len(status), 1), bool), chain], axis=1)

        arrays = (self.up, self.bare_of_lines, self.strong, self.bare_of_options)
        return _Statuses(*map(chained, arrays))


def _tree(case: Case, weight: Floats) -> tuple[Tree, Ints]:
    """The choice and a chain per storm, and the slot of every node."""
    n, slots = len(weight), case.slots
    names = [case.slot_label(t) for t in range(slots)]
    parent = np.arange(n * slots)
    parent[::slots] = 0
    labels = [f"{name}{IN}storm {k + 1}" for k in range(n) for name in names]
    tree = Tree(
        np.append(-1, parent),
        np.append(1.0, np.repeat(weight, slots)),
        np.append(0, np.ones(n * slots, np.intp)),
        ("before", *labels),
    )
    return tree, np.append(0, np.tile(np.arange(slots), n))
