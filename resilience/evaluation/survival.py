"""How long the loads of a microgrid last without the main grid, by the hour at which it is lost.

Every start is an episode of a batch: the grid is gone for as long as the longest duration that is
asked for, storage and tanks are as at the start of the case, lines hold, and load and PV are those
of the profiles from that hour on. A duration is survived if nothing is shed until then, so that one
simulation answers for all of them. Deliveries of fuel come so many hours after the start.

REopt asks so (Laws et al., Impacts of valuing resilience on cost-optimal PV and storage systems for
commercial buildings, Renewable Energy 127, 2018), of one bus; here islands are those of the feeder.

A saved one is a folder that appears whole or not at all; what is in it is `FILES`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import ndtri

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case, case_text, load_case
from resilience.case.critical import critical_loads
from resilience.case.days import profile_times
from resilience.case.schema.tables import MAX_SLOTS
from resilience.dispatch.registry import REFERENCE, Factory, factory_of
from resilience.errors import UsageError
from resilience.evaluation.measures.metrics import time_to_first_shed
from resilience.files import reading
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.units import with_units
from resilience.models.microgrid import Microgrid
from resilience.progress import meter
from resilience.results import (
    SUMMARY_FILE,
    SURVIVAL,
    replacing,
    stated_kind,
    steady,
    write_readme,
    write_summary,
)
from resilience.shown import Shown
from resilience.simulation.observation import Forecast, Observation, parts_of
from resilience.simulation.stepping import stepped
from resilience.simulation.world import World

if TYPE_CHECKING:
    import pandas as pd

DURATIONS_H = (6.0, 12.0, 24.0, 48.0, 72.0, 96.0, 120.0, 168.0)
STARTS_AT_ONCE = 2048
Z_95 = float(ndtri(0.975))
STARTS = "starts.parquet"
FILES = {
    SUMMARY_FILE: "what `--json` prints: case, method, and a row per duration",
    "durations.csv": "a row per duration in h: starts that it fits behind, and of these the share "
    "in which critical loads, and all loads, are fully served, each with its 95 % interval",
    f"starts.csv, {STARTS}": "a row per start, when the grid is lost: hours of profiles from there "
    "on (ahead_h), and hours until any load (all_h), and a critical one (critical_h, where some "
    "are), is first shed; inf: never",
    "case.toml": "the case without its grid, over the longest duration; it loads back",
}
"""What is in every file of a saved survival."""


@dataclass(frozen=True, repr=False)
class Survival(Shown):
    """How long loads last, start by start.

    Attributes:
        case: the case, without its grid.
        method: who dispatches.
        durations_h: that are asked for, hours, ascending.
        start: (starts,) when the grid is lost.
        ahead_h: (starts,) hours of profiles from there on.
        critical_h: (starts,) hours until a critical load is first shed; inf: never. None where no
            load is critical.
        all_h: (starts,) hours until any load is first shed.
    """

    case: Case = field(repr=False)
    method: str
    durations_h: tuple[float, ...]
    start: np.ndarray = field(repr=False)
    ahead_h: Floats = field(repr=False)
    critical_h: Floats | None = field(repr=False)
    all_h: Floats = field(repr=False)

    def frame(self) -> pd.DataFrame:
        """A row per duration: starts that it fits behind, and of these the share in which critical
        loads and all loads are fully served, each with a 95 % interval.
        """
        import pandas as pd

        rows = []
        for hours in self.durations_h:
            fits = self.ahead_h >= hours
            row = {"duration_h": hours, "starts": int(fits.sum())}
            for name, lasts_h in (("critical", self.critical_h), ("all", self.all_h)):
                share = math.nan if lasts_h is None else float((lasts_h[fits] >= hours).mean())
                low, high = _wilson(share, self._independent(hours, int(fits.sum())))
                row |= {f"{name}_served": share, f"{name}_low": low, f"{name}_high": high}
            rows.append(row)
        return pd.DataFrame(rows).set_index("duration_h")

    def _independent(self, hours: float, starts: int) -> float:
        """How many outages of that length the starts are worth: those that do not overlap, and one
        a day where they are short.
        """
        days = starts * self._every_h / 24.0
        return max(min(days, days * 24.0 / hours), 1.0)

    @cached_property
    def _every_h(self) -> float:
        apart = np.diff(self.start[:2]) / np.timedelta64(1, "h")
        return float(apart[0]) if len(apart) else 24.0

    def starts(self) -> pd.DataFrame:
        """A row per start: hours until a critical load, and until any load, is first shed."""
        import pandas as pd

        columns = {"ahead_h": self.ahead_h, "all_h": self.all_h}
        if self.critical_h is not None:
            columns["critical_h"] = self.critical_h
        return pd.DataFrame(columns, index=pd.Index(self.start, name="start"))

    def summary(self) -> dict[str, Any]:
        """Plain data; what is not defined is None."""
        table = self.frame().reset_index()
        rows = [
            {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()}
            for row in table.to_dict("records")
        ]
        return {"case": self.case.name, "method": self.method, "durations": rows}

    def save(self, folder: str | Path) -> Path:
        """Writes the folder; an earlier one is replaced, anything else is refused.

        Raises:
            UsageError: the folder holds something else.
            FileError: the system refuses, as where a disk is full.
        """
        with replacing(Path(folder), SURVIVAL) as target:
            starts = self.starts()
            self.frame().to_csv(target / "durations.csv")
            starts.to_csv(target / "starts.csv", na_rep="nan")
            starts.to_parquet(target / STARTS)
            (target / "case.toml").write_text(case_text(self.case), encoding="utf-8")
            write_readme(target, SURVIVAL, FILES)
            write_summary(target, SURVIVAL, self.summary())
        return Path(folder)


def load_survival(folder: str | Path) -> Survival:
    """Reads what `Survival.save` wrote.

    Raises:
        UsageError: the folder holds no survival, or a damaged one.
    """
    root = Path(folder)
    with steady(root):
        if not holds_survival(root):
            raise UsageError(
                f"{root} holds no survival; allowed: what `resilience survive --out` wrote",
                hint="name the folder that was given to --out",
            )
        return _load_survival(root)


def holds_survival(folder: Path) -> bool:
    """Whether a folder holds what `Survival.save` writes."""
    return stated_kind(folder) == SURVIVAL.name


def _load_survival(root: Path) -> Survival:
    import pandas as pd

    case = load_case(root / "case.toml")
    with reading(root, "survival"):
        summary = json.loads((root / SUMMARY_FILE).read_text(encoding="utf-8"))
        starts = pd.read_parquet(root / STARTS)
        survival = Survival(
            case,
            summary["method"],
            tuple(float(row["duration_h"]) for row in summary["durations"]),
            starts.index.to_numpy().astype("datetime64[us]"),
            starts["ahead_h"].to_numpy(float),
            starts["critical_h"].to_numpy(float) if "critical_h" in starts else None,
            starts["all_h"].to_numpy(float),
        )
        if survival.summary()["durations"] != summary["durations"]:
            raise ValueError(f"{SUMMARY_FILE} and {STARTS} contradict each other")
    return survival


@dataclass(frozen=True)
class _Starts(World):
    """A world in which every scenario begins at another slot of long profiles.

    Attributes:
        first: (scenarios,) slot of `values` at which each begins.
        values: profiles of the devices over all slots there are.
    """

    first: Ints = field(default_factory=lambda: np.zeros(0, np.intp))
    values: Mapping[str, Floats] = field(default_factory=dict)

    def profile(self, name: str | None, slots: Ints) -> Floats:
        """(len(slots), scenarios) from each one's own start; at the end the last slot stays."""
        if name is None or name not in self.values:
            return super().profile(name, slots)
        values = self.values[name]
        return values[np.minimum(self.first + np.asarray(slots)[:, None], len(values) - 1)]

    def forecast(self, now: int) -> Forecast:
        """What comes is known."""
        return self.profile


def survive(
    case: Case | str | Path,
    durations_h: Sequence[float] | None = None,
    *,
    method: str = REFERENCE,
    every_h: float = 1.0,
    seed: int = 0,
) -> Survival:
    """How long loads last without the main grid, from every hour of the profiles on.

    Args:
        case: a case, its file, or the name of an installed one.
        durations_h: of the loss of the grid, hours; if omitted, those of `DURATIONS_H` that the
            profiles have.
        method: who dispatches, a name that `compare` knows.
        every_h: hours from one start to the next.
        seed: of the failures of units, drawn anew for every start where the case says that they
            fail: the shares are probabilities over starts and failures then.

    Raises:
        CaseError: the case has mistakes, or cannot do without a grid; all of them are listed.
        UsageError: durations or hours out of range, an unknown method, profiles that are shorter
            than the longest duration, or a case without loads.
    """
    case = case if isinstance(case, Case) else load_case(case)
    make, (full_case, durations, every) = factory_of(method), _checked(case, durations_h, every_h)
    slots = math.ceil(durations[-1] / full_case.step_h - 1e-9)
    first = np.arange(0, full_case.slots, every)
    island = full_case.replace(slots=slots, grid=[])
    microgrid = Microgrid.build(island, "copperplate")
    # Fuel comes at hours of the outage, all else at hours of the profiles.
    deliveries = () if microgrid.tanks is None else tuple(microgrid.tanks.profiles())
    values = {name: v for name, v in full_case.profiles.items() if name not in deliveries}
    critical = critical_loads(island)
    lasts = np.full((2, len(first)), np.inf)
    with meter("outages", slots * len(first)) as progress:
        for begin in range(0, len(first), STARTS_AT_ONCE):
            chunk = slice(begin, begin + STARTS_AT_ONCE)
            n = len(first[chunk])
            calm = Scenarios((), np.zeros((0, slots, n), bool), np.full(n, 1.0 / n))
            usual = World.build(microgrid, with_units(island, calm, seed + begin))
            world = _Starts(
                **{k: v for k, v in vars(usual).items() if k in World.__dataclass_fields__},
                first=first[chunk], values=values,
            )  # fmt: skip
            lasts[:, chunk] = _lasts_h(world, make, critical, progress.advance)
    times = np.datetime64(full_case.start) + first * np.timedelta64(
        round(full_case.step_min * 60), "s"
    )
    return Survival(
        island, method, durations, times,
        np.asarray((full_case.slots - first) * full_case.step_h, float),
        lasts[0] if critical.any() else None, lasts[1],
    )  # fmt: skip


def _checked(
    case: Case, durations_h: Sequence[float] | None, every_h: float
) -> tuple[Case, tuple[float, ...], int]:
    """The case over all of its profiles, durations in order, and slots from start to start.

    Raises:
        UsageError: what is asked for is out of range.
    """
    if not case.load:
        raise UsageError(
            f"case {case.name!r} has no loads that a loss of the grid could leave unserved; "
            "allowed: one or more",
            hint="[[load]] with bus, p_max_mw and shed_cost_per_mwh adds one",
        )
    times = profile_times(case)
    full_case = case.replace(outages=())
    if times is not None:
        start = times[0].astype("datetime64[s]").item()
        full_case = full_case.replace(start=start, slots=min(len(times), MAX_SLOTS))
    span_h = full_case.slots * full_case.step_h
    usual = [d for d in DURATIONS_H if full_case.step_h <= d <= span_h]
    durations = tuple(sorted({float(d) for d in (usual if durations_h is None else durations_h)}))
    wrong = [d for d in durations if not full_case.step_h <= d <= span_h]
    if wrong or not durations:
        raise UsageError(
            f"durations {', '.join(f'{d:g}' for d in wrong) or 'none'} h; allowed: one or more, "
            f"{full_case.step_h:g} to {span_h:g} h, what the profiles of case {case.name!r} have",
            hint="6, 12, 24, 48, 72, 96, 120 and 168 h are usual",
        )
    every = every_h / full_case.step_h
    if not every >= 1.0 or abs(every - round(every)) > 1e-9:
        raise UsageError(
            f"a start every {every_h:g} h; allowed: a multiple of the slot, {full_case.step_h:g} h",
            hint="1 is usual",
        )
    return full_case, durations, round(every)


def _lasts_h(
    world: _Starts, make: Factory, critical: Bools, advance: Callable[[int], None]
) -> Floats:
    """(critical loads and all, starts) hours until one is first shed; inf: never.

    Args:
        world: the starts.
        make: makes the dispatcher.
        critical: (loads,) which loads are critical.
        advance: is told of every slot how many starts have passed it.
    """
    simulator, case, n = world.simulator, world.microgrid.case, world.scenarios.n
    rows = np.array([k for k, name in enumerate(simulator.columns) if ".shed[" in name])
    kinds = (rows[critical], rows)
    lasts = np.full((len(kinds), n), np.inf)
    dispatcher, energy, fuel = make(world.setting), world.start(), world.setting.start_fuel()
    states, unknown = world.setting.start_states(), np.full(n, -1)
    for t in range(case.slots):
        slot = world.slot(t, energy)
        observation = Observation(
            t, energy, world.line_up[:, t], slot.island, unknown, world.forecast(t), slot.stacked,
            fuel, states, world.line_up_before(t),
        )  # fmt: skip
        step = stepped(simulator, observation, parts_of(dispatcher.act(observation)))
        for lasts_h, kind in zip(lasts, kinds, strict=True):
            sheds = np.isfinite(time_to_first_shed(step.flows[kind][:, None], case.step_h))
            lasts_h[sheds & np.isinf(lasts_h)] = t * case.step_h
        energy, fuel, states = step.energy, step.fuel, step.states
        advance(n)
    return lasts


def _wilson(share: float, n: float) -> tuple[float, float]:
    """95 % interval of a share of n trials (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    if math.isnan(share):
        return math.nan, math.nan
    wide = Z_95**2 / n
    centre = (share + wide / 2.0) / (1.0 + wide)
    half = Z_95 / (1.0 + wide) * math.sqrt(share * (1.0 - share) / n + wide / (4.0 * n))
    return max(centre - half, 0.0), min(centre + half, 1.0)
