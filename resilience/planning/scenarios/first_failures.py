"""What a plan over scenarios does when an outage shows, by the lines that fail first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.components import device_fleets, in_roles
from resilience.planning.reading.instructions import NOTABLE_SHARE

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.planning.scenarios.plan import ScenarioPlan

WINDOW_H = 2.0
"""How long behind the failure responses are summed up."""
ENDS = (0.05, 0.95)
"""Quantiles over scenarios between which times and powers are said to lie."""


@dataclass(frozen=True)
class UnitResponse:
    """What a unit does in the first hours behind a failure, over the scenarios that have it.

    Attributes:
        unit: its name.
        mean_mw: fed in on average; a storage that charges takes, below 0.
        low_mw, high_mw: between which 90 % of the scenarios lie.
    """

    unit: str
    mean_mw: float
    low_mw: float
    high_mw: float


@dataclass(frozen=True)
class FirstFailure:
    """Scenarios whose common schedule ends with the failure of the same lines.

    Attributes:
        lines: that are down in the first slot of the outage.
        probability: of it.
        earliest, latest: slots between which 90 % of them begin.
        responses: of storage and generators that do anything.
        shed_mwh: on average over these scenarios, to the end of the horizon.
    """

    lines: tuple[str, ...]
    probability: float
    earliest: int
    latest: int
    responses: tuple[UnitResponse, ...]
    shed_mwh: float


def first_failures(plan: ScenarioPlan) -> list[FirstFailure]:
    """What follows when an outage shows, the likeliest first; nothing without case or scenarios."""
    case, outages = plan.case, plan.outages
    if case is None or outages is None:
        return []
    leaves = np.asarray(plan.episodes["leaves_slot"], np.intp)
    groups: dict[tuple[str, ...], list[int]] = {}
    for k, slot in enumerate(leaves.tolist()):
        if slot < outages.slots:
            down = np.flatnonzero(outages.down[:, slot, k])
            groups.setdefault(tuple(outages.lines[i] for i in down), []).append(k)
    groups.pop((), None)
    failures = [
        _failure(plan, case, lines, np.array(members, np.intp), leaves)
        for lines, members in groups.items()
    ]
    return sorted(failures, key=lambda failure: -failure.probability)


def _failure(
    plan: ScenarioPlan, case: Case, lines: tuple[str, ...], members: Ints, leaves: Ints
) -> FirstFailure:
    weight = np.asarray(plan.episodes["probability"], float)[members]
    total = float(weight.sum())
    share = weight / total if total > 0.0 else np.full(len(members), 1.0 / len(members))
    slots = max(round(WINDOW_H / case.step_h), 1)
    labels, power = plan.recourse
    responses = []
    for fleet in in_roles(device_fleets(case).values(), "storage", "dispatchable"):
        for name, size in zip(fleet.names, fleet.size_mw(), strict=True):
            row = power[labels.index(name)]
            mw = np.array([row[s : s + slots, k].mean() for s, k in _begins(leaves, members)])
            if np.abs(mw).max(initial=0.0) > NOTABLE_SHARE * size:
                low, high = _quantiles(mw, share)
                responses.append(UnitResponse(name, float(share @ mw), low, high))
    earliest, latest = _quantiles(leaves[members].astype(float), share)
    shed_mwh = float(share @ np.asarray(plan.episodes["shed_mwh"], float)[members])
    return FirstFailure(lines, total, int(earliest), int(latest), tuple(responses), shed_mwh)


def _begins(leaves: Ints, members: Ints) -> list[tuple[int, int]]:
    """(slot of the failure, scenario) of every member."""
    return list(zip(leaves[members].tolist(), members.tolist(), strict=True))


def _quantiles(values: Floats, share: Floats) -> tuple[float, float]:
    """The two quantiles of weighted values, each one of them."""
    order = np.argsort(values, kind="stable")
    below = np.cumsum(share[order])
    places = [min(int(np.searchsorted(below, end - 1e-12)), len(order) - 1) for end in ENDS]
    return float(values[order[places[0]]]), float(values[order[places[1]]])
