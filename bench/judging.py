"""Judging: the clairvoyant bound, what an episode costs apart from decisions, AC certification."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from bench.row import Row, below, timed
from resilience.case import load_case
from resilience.case.days import held_out
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.rules import Idle
from resilience.evaluation.ac_check import ac_check_trajectory
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import case_bell
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World

DAYS, DRAWS = 16, 8
MAX_SHARE = 0.5  # of an episode of the fastest solver-based method


def judging() -> Iterator[Row]:
    case = held_out(load_case("ieee33-tou"), DAYS)
    microgrid, bell = Microgrid.build(case, "copperplate"), case_bell(case)
    worlds = {n: World.build(microgrid, sample_bell(case, bell, n, 0)) for n in (1, DRAWS)}
    single, all_draws = (timed(clairvoyant, worlds[n])[0] for n in (1, DRAWS))
    further = (all_draws - single) / (DRAWS - 1)
    note = f"{case.slots:,} slots, once {single:.2f} s for the first"
    yield below(f"clairvoyant bound, {DAYS} days, a further draw", further, 1.0, "s", note)
    idle = timed(lambda: simulate(worlds[1], Idle(worlds[1].setting)))[0]
    make = partial(DISPATCHERS["mpc-blind"], worlds[1].setting)
    blind = timed(lambda: simulate(worlds[1], make()))[0]
    note = f"{idle:.2f} s without decisions, {blind:.2f} s with those of mpc-blind"
    yield below("an episode's share apart from decisions", idle / blind, MAX_SHARE, "", note)
    trajectory = simulate(worlds[DRAWS], DISPATCHERS["rule"](worlds[DRAWS].setting))
    seconds, _ = timed(ac_check_trajectory, worlds[DRAWS], trajectory)
    members = trajectory.cost.size
    note = f"{members:,} members, islands included, {members / seconds:,.0f} a second"
    yield below(f"AC certification, {DAYS} days x {DRAWS} draws", seconds, 5.0, "s", note)
