"""`Hardening`: what to build before the storm, what it saves, and how sure that is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case import Case
from resilience.errors import UsageError
from resilience.models.program.risk import Risk
from resilience.planning.hardening.draws import StrengthOption
from resilience.planning.hardening.evaluation import StormOutcomes
from resilience.planning.hardening.program import Option
from resilience.planning.hardening.saving import write_hardening
from resilience.planning.hardening.search import Choice
from resilience.planning.hardening.season import Season
from resilience.planning.hardening.sites import UnitOption
from resilience.planning.hardening.yearly import Years

if TYPE_CHECKING:
    import pandas as pd

MEASURES = ("cost", "shed_mwh", "critical_mwh", "critical_h", "customer_h")


@dataclass(frozen=True, eq=False)
class Hardening:
    """What to build, proven against some storms and judged on others.

    Arrays of options are (options,), in the order of `options`.

    Attributes:
        case: the case, in the steps that were planned for.
        options: what could be built.
        risk: the objective over storms.
        choice: the plan, proven on the storms that it was made for.
        wanted_gap: relative gap that was asked for.
        frontier: plans for other budgets, by rising budget.
        sets: what is built, by name: `nothing`; the `plan`; `greedy`, what saves most per $ one by
            one; `naive`, the lines most likely to fail; `all`, every line at its strongest and
            every unit.
        fails: probability that the line of an option is down in a storm at all, as it is; NaN of
            units and ties.
        alone: $ of the risk that each option saves alone, on the storms of the plan.
        beside: $ that each saves beside the plan: of the chosen ones what it would cost to leave
            them out, of others what they would save besides.
        in_sample: by set, the storms of the plan, as they really are.
        without_crews: $ of the risk of the plan, on its own storms, with crews without limit.
        out_of_sample: by set, storms that the plan has not seen.
        storms, new_storms: how many.
        seed, new_seed: of their draws.
        seconds: by phase.
        notes: what a reader should know.
        season: the storms, and how often each comes beside the others.
        years: how often storms come, and what money costs; with it the objective, its bound, and
            what options save are in $ a year, what is built paid for; None: in $ a storm.
        annual_cost: (options,) $ a year for each; None without `years`.
    """

    case: Case = field(repr=False)
    options: tuple[Option, ...] = field(repr=False)
    risk: Risk
    choice: Choice = field(repr=False)
    wanted_gap: float
    frontier: tuple[Choice, ...] = field(repr=False)
    sets: dict[str, Bools] = field(repr=False)
    fails: Floats = field(repr=False)
    alone: Floats = field(repr=False)
    beside: Floats = field(repr=False)
    in_sample: dict[str, StormOutcomes] = field(repr=False)
    without_crews: float
    out_of_sample: dict[str, StormOutcomes] = field(repr=False)
    storms: int
    new_storms: int
    seed: int
    new_seed: int
    seconds: dict[str, float] = field(repr=False)
    notes: tuple[str, ...] = field(repr=False)
    season: Season = field(repr=False)
    years: Years | None = None
    annual_cost: Floats | None = field(default=None, repr=False)

    @property
    def budget(self) -> float:
        """$ that might be spent."""
        return self.choice.budget

    @property
    def chosen(self) -> tuple[Option, ...]:
        """What is built."""
        return tuple(self.options[k] for k in np.flatnonzero(self.choice.chosen))

    @property
    def cost(self) -> float:
        """$ to build it."""
        return float(sum(option.cost for option in self.chosen))

    @property
    def status(self) -> str:
        """`optimal` where the gap that was asked for is proven, else `feasible`."""
        return "optimal" if self.choice.gap <= self.wanted_gap else "feasible"

    @cached_property
    def next_best(self) -> Option | None:
        """The option that saves most per $ beside the plan; None where none saves anything."""
        lines = {option.line for option in self.chosen if isinstance(option, StrengthOption)}
        open_ = ~self.choice.chosen & np.isfinite(self.beside)
        for k, option in enumerate(self.options):
            open_[k] &= not (isinstance(option, StrengthOption) and option.line in lines)
        price = np.array([max(option.cost, 1e-300) for option in self.options])
        worth = np.where(open_, np.nan_to_num(self.beside, posinf=0.0) / price, -math.inf)
        best = int(np.argmax(worth))
        return self.options[best] if worth[best] > 0.0 else None

    def frame(self) -> pd.DataFrame:
        """A row per option: cost, failures, what it saves alone and beside the plan, chosen.

        Lines have a factor, units of sites a kind and a bus; what is not so is None or NaN.
        """
        import pandas as pd

        lines = [None if isinstance(o, UnitOption) else o for o in self.options]
        units = [o if isinstance(o, UnitOption) else None for o in self.options]
        return pd.DataFrame(
            {
                "line": [option and option.line for option in lines],
                "factor": [getattr(option, "factor", np.nan) for option in lines],
                "site": [option and option.site for option in units],
                "kind": [option and option.kind for option in units],
                "bus": [option and option.unit.bus for option in units],
                "cost": [option.cost for option in self.options],
                "life_years": [option.life_years for option in self.options],
                "fails": self.fails,
                "saves_alone": self.alone,
                "saves_beside": self.beside,
                "chosen": self.choice.chosen,
            },
            index=pd.Index([option.label for option in self.options], name="option"),
        )

    def comparison(self, *, new: bool = True) -> pd.DataFrame:
        """A row per set: the mean of every measure and its standard error, CVaR, what is saved.

        Args:
            new: on the storms that the plan has not seen; else on its own.
        """
        import pandas as pd

        outcomes = self.out_of_sample if new else self.in_sample
        rows = {}
        for name, storms in outcomes.items():
            row: dict[str, float] = {"built": int(self.sets[name].sum())}
            for measure in MEASURES:
                row |= {measure: storms.mean(measure), f"{measure}_error": storms.error(measure)}
            saved, error = storms.saving(outcomes["nothing"])
            alpha = self.risk.alpha
            rows[name] = row | {"cvar": storms.cvar(alpha), "saved": saved, "saved_error": error}
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("set")

    def by_storm(self, *, new: bool = True) -> pd.DataFrame:
        """A row per storm of the season: how often it comes, and $ of each with every set built.

        Args:
            new: of the draws that the plan has not seen; else of its own.
        """
        import pandas as pd

        outcomes = self.out_of_sample if new else self.in_sample
        member = self.season.storm_of(self.new_storms if new else self.storms)
        table = pd.DataFrame({"share": self.season.share}, index=list(self.season.names))
        if self.years is not None:
            table.insert(0, "per_year", self.season.share * self.years.storms_per_year)
        for name, storms in outcomes.items():
            weight = np.bincount(member, storms.probability)
            table[name] = np.bincount(member, storms.probability * storms.cost) / weight
        return table.rename_axis("storm")

    def draws(self) -> pd.DataFrame:
        """A row per set and storm that was drawn, those of the plan first."""
        import pandas as pd

        names, rows = np.array(self.season.names), []
        for sample, sets in (("plan", self.in_sample), ("new", self.out_of_sample)):
            for name, storms in sets.items():
                member = names[self.season.storm_of(len(storms.cost))]
                columns = {"sample": sample, "storm": member, "probability": storms.probability}
                columns |= {measure: getattr(storms, measure) for measure in MEASURES}
                index = pd.Index([name] * len(storms.cost), name="set")
                rows.append(pd.DataFrame(columns, index=index))
        return pd.concat(rows)

    def yearly(self, *, new: bool = True) -> pd.DataFrame:
        """A row per set, in $ a year: what is built, storms, and what is saved net, with its error.

        Args:
            new: on the storms that the plan has not seen; else on its own.

        Raises:
            UsageError: nobody says how many storms come in a year.
        """
        if self.years is None or self.annual_cost is None:
            raise UsageError(
                f"case {self.case.name!r} does not say how many storms come in a year",
                hint="state storms_per_year in [plan]",
            )
        storms = self.comparison(new=new)[["cost", "saved", "saved_error"]]
        table = storms * self.years.storms_per_year
        table.insert(
            0, "built", [float(self.annual_cost @ self.sets[name]) for name in table.index]
        )
        table["saved"] -= table["built"]
        return table.rename(columns={"cost": "storms"})

    def frontier_frame(self) -> pd.DataFrame:
        """A row per budget: what is spent, the risk in $, its bound, and what is built."""
        import pandas as pd

        cost = np.array([option.cost for option in self.options])
        return pd.DataFrame(
            {
                "spent": [float(cost @ choice.chosen) for choice in self.frontier],
                "value": [choice.value for choice in self.frontier],
                "bound": [choice.bound for choice in self.frontier],
                "built": [self._labels(choice.chosen) for choice in self.frontier],
            },
            index=pd.Index([choice.budget for choice in self.frontier], name="budget"),
        )

    def _labels(self, chosen: Bools) -> str:
        return ", ".join(self.options[k].label for k in np.flatnonzero(chosen))

    def summary(self) -> dict[str, Any]:
        """Plain data; what is not defined is None."""
        best = self.next_best
        return _plain(
            {
                "case": self.case.name,
                "risk": str(self.risk),
                "budget": self.budget,
                "cost": self.cost,
                "status": self.status,
                "objective": self.choice.value,
                "bound": self.choice.bound,
                "gap": self.choice.gap,
                "rounds": self.choice.rounds,
                "without_crews": self.without_crews,
                "storms": self.storms,
                "new_storms": self.new_storms,
                "seed": self.seed,
                "new_seed": self.new_seed,
                "built": [option.label for option in self.chosen],
                "next_best": None if best is None else best.label,
                "options": self.frame().reset_index().to_dict("records"),
                "in_sample": self.comparison(new=False).reset_index().to_dict("records"),
                "out_of_sample": self.comparison().reset_index().to_dict("records"),
                "frontier": self.frontier_frame().reset_index().to_dict("records"),
                "by_storm": self.by_storm().reset_index().to_dict("records"),
                "storms_per_year": None if self.years is None else self.years.storms_per_year,
                "interest_rate": None if self.years is None else self.years.interest_rate,
                "yearly": (
                    None if self.years is None else self.yearly().reset_index().to_dict("records")
                ),
                "seconds": self.seconds,
                "notes": list(self.notes),
            }
        )

    def save(self, folder: str | Path) -> Path:
        """Writes the folder, see `saving`; an earlier one is replaced, anything else is refused.

        Raises:
            UsageError: the folder holds something else.
            FileError: the system refuses, as where a disk is full.
        """
        tables = {
            "options": self.frame(),
            "sets": self.comparison(),
            "by_storm": self.by_storm(),
            "frontier": self.frontier_frame(),
            "draws": self.draws(),
        }
        if self.years is not None:
            tables["yearly"] = self.yearly()
        return write_hardening(Path(folder), self.case, tables, self.summary())


def _plain(value: Any) -> Any:
    """Plain data without numbers that JSON has no word for."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
