"""`compare`: every dispatcher on the same storms, measured against the clairvoyant bound.

Random numbers are common: outages and forecast errors are drawn up front from seeds of their own,
so that every method meets the same episodes. An episode is the whole path over all days, its state
of charge carried over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from resilience.case import Case, load_case
from resilience.case.days import held_out
from resilience.case.schema.fields import MAX_PRICE_PER_MWH
from resilience.dispatch.comb import COMB, comb_optimum, is_small_comb
from resilience.dispatch.registry import DISPATCHERS, REFERENCE, Factory, factory_of
from resilience.errors import UsageError, check_range
from resilience.evaluation.ac_check import TrajectoryACCheck, ac_check_trajectory
from resilience.evaluation.bounds.dual_bound import (
    beyond_dual_bound,
    no_dual_bound,
    prove_dual_bound,
)
from resilience.evaluation.comparison import BOUND
from resilience.evaluation.engines import Engine, check_engine
from resilience.evaluation.measures.measures import measure
from resilience.evaluation.report import Report
from resilience.evaluation.runs import proven_bound, run_all, what_is_there
from resilience.evaluation.store import Store
from resilience.fragility.draw import sample_case
from resilience.fragility.outages.files import load_scenarios
from resilience.fragility.outages.scenarios import Scenarios
from resilience.inputs import to_number
from resilience.models.microgrid import Physics
from resilience.progress import interruptible, notice, phase
from resilience.results import COMPARISON, check_replaceable
from resilience.simulation.causality import causality_text, check_causality
from resilience.simulation.forecast import (
    FEEDER_COMMON,
    FEEDER_SIGMA,
    MEASURED_CORRELATION,
    MEASURED_SIGMA,
    ForecastError,
    sample_outlook,
)
from resilience.simulation.powers import demand
from resilience.simulation.setting import CASE, Believed, no_belief
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines

ERRORS = {
    "ar1": ForecastError(MEASURED_SIGMA, MEASURED_CORRELATION),
    "gaussian": ForecastError(MEASURED_SIGMA, 0.0),
    "feeder": ForecastError(FEEDER_SIGMA, MEASURED_CORRELATION, FEEDER_COMMON),
}
Methods: TypeAlias = "Sequence[str] | Mapping[str, Factory | str]"

__all__ = ["Report", "compare", "evaluate", "held_out"]


def compare(  # noqa: PLR0913 every one is an option of the command line
    case: Case | str | Path,
    methods: Methods = ("rule", "mpc-blind", "mpc", "stochastic"),
    *,
    days: int | None = None,
    draws: int = 32,
    seed: int = 0,
    scenarios: Scenarios | str | Path | None = None,
    believe: Scenarios | str | Path | None = None,
    physics: Physics = "copperplate",
    end_value_per_mwh: float | None = None,
    forecast_error: ForecastError | str | None = None,
    known_centre: bool = True,
    reset_daily: bool = False,
    workers: int = 1,
    engine: Engine = "local",
    ac: bool = False,
    causality: bool = False,
    dual_bound: bool = False,
    out: str | Path | None = None,
    save: bool = True,
) -> Report:
    """Runs dispatchers over the test days, every one of them on the same outage draws.

    Args:
        case: a case, its file, or the name of an installed one.
        methods: names from `DISPATCHERS`, `METHOD:RUN` for a trained policy, or names of one's own,
            each with one of these or a function from a `Setting` to a dispatcher; rule 0.9 and the
            clairvoyant always act.
        days: days of an episode, the last ones of the profiles, 16 if omitted. A case with a storm
            keeps its own horizon, on which the storm is laid.
        draws: how many outage paths; every one is an episode. With fewer than 32, an interval may
            say little of a method that sheds rarely.
        seed: of the outage paths, and, as a stream of its own, of the forecast errors.
        scenarios: outage paths, or their file, to use in place of draws; `days` must be theirs.
        believe: what operators hold of outages to come: other outage paths, or their file, over the
            same days; "case", the case's own process, as where storms are drawn; or "same", the
            very scenarios that come, though nobody is told which. To be named with `scenarios` by
            whoever plans ahead: the case's process may have nothing to do with them.
        physics: of everybody, the bound included.
        end_value_per_mwh: worth of energy left, $/MWh; the case's terminal value if omitted.
        forecast_error: how load and PV differ from their forecast: "ar1" with the measured
            correlation 0.97, "gaussian" with none (the paper's), "feeder" with 10 % of which 70 %
            are common to all, "SIGMA,RHO", "SIGMA,RHO,COMMON", or None: not at all.
        known_centre: operators are told at midnight where the day's hazard is forecast to peak.
        reset_daily: the state of charge starts anew every midnight; the report warns of it.
        workers: processes; numbers do not depend on them.
        engine: local, dask or ray; nor on it.
        ac: certifies all trajectories by AC power flow.
        causality: first checks that no method acts on what has not happened yet, see
            `check_causality`.
        dual_bound: also proves what nobody without foreknowledge stays below on average, see
            `bounds.dual_bound`; for storms drawn from the case's own bell or blackout.
        out: folder for the report; every finished part is written to it at once, and a call that
            was interrupted goes on from there.
        save: whether the report is written there, too, once it is complete.

    Raises:
        CaseError: the case has mistakes; all of them are listed.
        UsageError: an unknown method, engine or forecast error; more days than the profiles keep
            for tests; scenarios of another horizon; storms that are given without a belief for a
            method that has one; physics that nothing simulates; a folder that
            holds something else.
        FileError: a folder that cannot be written to.
        CertificateError: a method that acts on the future, where that is checked.
    """
    if out is not None:
        check_replaceable(Path(out), COMPARISON)
    makers, error = _makers(methods), parse_error(forecast_error)
    if end_value_per_mwh is not None:
        limit = MAX_PRICE_PER_MWH
        check_range("end value", end_value_per_mwh, -limit, limit, hint="$/MWh")
    case = held_out(case if isinstance(case, Case) else load_case(case), days)
    storms = _storms(case, scenarios, draws, seed)
    believed = _believed(case, believe, storms, are_given=scenarios is not None)
    if believed is None and any(getattr(make, "believes", False) for make in makers.values()):
        raise no_belief()
    world = World.build(
        microgrid_with_fallible_lines(case, storms, physics),
        storms,
        end_value_per_mwh=end_value_per_mwh,
        outlook=sample_outlook(case, error, storms.n, _error_seed(seed)) if error else None,
        known_centre=known_centre,
        reset_daily=reset_daily,
        believed=believed,
    )
    if scenarios is None and is_small_comb(world.setting):
        makers.setdefault(COMB, DISPATCHERS[COMB])
    if dual_bound and (reason := beyond_dual_bound(world)):
        raise no_dual_bound(reason)
    if causality:
        slots = check_causality(world, makers)
        notice(causality_text(makers, slots, world))
    return evaluate(
        world,
        makers,
        workers=workers,
        engine=engine,
        ac=ac,
        out=out,
        save=save,
        forecast_error=_text(error),
        dual=dual_bound,
    )


def _storms(case: Case, source: Scenarios | str | Path | None, draws: int, seed: int) -> Scenarios:
    """Scenarios as they are, from their file, or drawn where there are none."""
    if isinstance(source, str | Path):
        return load_scenarios(source, case)
    return source or sample_case(case, draws, seed)


def _believed(
    case: Case, source: Scenarios | str | Path | None, storms: Scenarios, *, are_given: bool
) -> Believed:
    """What operators hold of outages to come, as a user says it.

    Args:
        case: over the horizon of the evaluation.
        source: what the user says.
        storms: that are coming.
        are_given: they are not drawn from the case's own process.
    """
    if source is None:
        return None if are_given else CASE
    if isinstance(source, Scenarios):
        return source
    if str(source) == CASE:
        return CASE
    return storms if str(source) == "same" else load_scenarios(source, case)


def evaluate(  # noqa: PLR0913 as `compare`
    world: World,
    methods: Methods,
    *,
    workers: int = 1,
    engine: Engine = "local",
    ac: bool = False,
    out: str | Path | None = None,
    save: bool = True,
    forecast_error: str | None = None,
    dual: bool = False,
) -> Report:
    """Judges dispatchers in a world of one's own; `compare` makes the usual one.

    Args:
        world: case, storms, forecast errors and what operators are told.
        methods: as in `compare`.
        workers: processes.
        engine: local, dask or ray.
        ac: certifies all trajectories by AC power flow.
        out: folder for the report and for what is needed to go on after an interruption.
        save: whether the report is written there, too, once it is complete.
        forecast_error: how the report calls the errors of `world.outlook`.
        dual: also proves what nobody without foreknowledge stays below on average.

    Raises:
        UsageError: an unknown method or engine, or a folder that holds something else.
        FileError: a folder that cannot be written to.
    """
    makers: dict[str, Factory] = _makers(methods)
    makers[REFERENCE] = DISPATCHERS[REFERENCE]
    check_engine(engine, workers)
    store = None
    if out is not None:
        check_replaceable(Path(out), COMPARISON)
        store = Store(Path(out))
    with interruptible(lambda: what_is_there("all", store)):
        by_name = run_all(world, makers, workers=workers, engine=engine, store=store)
        trajectories = {name: by_name[name] for name in (*makers, BOUND)}
        report = _report(world, trajectories, ac, forecast_error, dual)
        if out is not None and save:
            with phase("writing"):
                report.save(out)
    return report


def _report(
    world: World,
    trajectories: Mapping[str, Trajectory],
    ac: bool,
    forecast_error: str | None,
    dual: bool,
) -> Report:
    demand_mw = demand(world)
    if forecast_error is None:
        forecast_error = "none" if world.outlook is None else "given"
    blind = {name: done for name, done in trajectories.items() if name != BOUND}
    return Report(
        world=world,
        trajectories=trajectories,
        measures={
            name: measure(world, trajectory, demand_mw) for name, trajectory in trajectories.items()
        },
        bound=proven_bound(trajectories[BOUND]),
        certificates=_ac_checks(world, trajectories) if ac else None,
        forecast_error=forecast_error,
        comb=comb_optimum(world.setting) if COMB in trajectories else None,
        dual=prove_dual_bound(world, blind) if dual else None,
    )


def _ac_checks(
    world: World, trajectories: Mapping[str, Trajectory]
) -> dict[str, TrajectoryACCheck]:
    """Method to what AC power flow says of its trajectory."""
    with phase("AC power flow"):
        return {
            name: ac_check_trajectory(world, trajectory)
            for name, trajectory in trajectories.items()
        }


def _makers(methods: Methods) -> dict[str, Factory]:
    """How to make every method.

    Raises:
        UsageError: an unknown name, none at all, one that is taken, or nothing that makes one.
    """
    if isinstance(methods, Mapping):
        if BOUND in methods:
            raise UsageError(
                f"a method is called {BOUND!r}; allowed: any other name",
                hint="the clairvoyant is the bound and always there",
            )
        return {name: _maker(name, method) for name, method in methods.items()}
    if isinstance(methods, str):
        methods = [name.strip() for name in methods.split(",") if name.strip()]
    if not methods:
        raise UsageError("no method; allowed: one or more", hint=f"{REFERENCE} is always there")
    names = [name for name in dict.fromkeys(methods) if name != BOUND]
    return {name: factory_of(name) for name in names}


def _maker(name: str, method: Factory | str) -> Factory:
    """How to make a method that a user calls by a name of their own.

    Raises:
        UsageError: an unknown method, or what is neither a name nor a function.
    """
    if isinstance(method, str):
        return factory_of(method)
    if not callable(method):
        raise UsageError(
            f"method {name!r} is {type(method).__name__}; allowed: the name of one, or a function "
            "from a Setting to a dispatcher",
            hint="a dispatcher is made anew for every comparison: lambda setting: Mine(setting)",
        )
    return method


def parse_error(text: ForecastError | str | None) -> ForecastError | None:
    """A forecast error from its name, from `SIGMA,RHO`, or from `SIGMA,RHO,COMMON`.

    Raises:
        UsageError: text that is neither, or a value out of range.
    """
    if text is None or isinstance(text, ForecastError):
        return text
    if text == "none":
        return None
    if text in ERRORS:
        return ERRORS[text]
    match [to_number(word.strip()) for word in text.split(",")]:
        case [float(sigma), float(correlation)]:
            return ForecastError(sigma, correlation)
        case [float(sigma), float(correlation), float(common)]:
            return ForecastError(sigma, correlation, common)
    raise UsageError(
        f"forecast error {text!r} cannot be read; allowed: none, {', '.join(ERRORS)}, or "
        "SIGMA,RHO[,COMMON]",
        hint="0.025,0.97 is measured: a standard deviation of 2.5 % that lasts for hours",
    )


def _text(error: ForecastError | None) -> str:
    """How a report calls a forecast error."""
    return str(error) if error else "none"


def _error_seed(seed: int) -> int:
    """A seed for forecast errors: the same one would repeat the streams of the outages."""
    return int(np.random.SeedSequence([seed, 1]).generate_state(1)[0])
