"""The one check of every network, whatever its source."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case.networks.network import Network

MAX_KV = 1000.0  # of a bus; beyond, V were given as kV
MAX_TAP = 4.0  # of a ratio in per unit; beyond, kV were given in place of it, or nominal voltages
ROUNDING_DEGREE = 1e-9  # of a phase shift
IDLE = "angle_{}_degree that lets the branch carry nothing: at its phase shift"
_FEW = 5


def network_findings(network: Network, key: str = "") -> Iterator[tuple[str, str, str, str]]:
    """What is wrong with the numbers of a network; none where it is sound.

    Args:
        network: as its source has it.
        key: of `[network]` that names the source.
    """
    vn_kv, low, high = network.vn_kv, network.v_min_pu, network.v_max_pu
    r, x, rating = network.r_pu, network.x_pu, network.rating_mva
    shift = np.degrees(np.angle(network.ratio))
    angle_min, angle_max = network.angle_min_degree, network.angle_max_degree
    charging, shunt = np.abs(network.y_from_pu) + np.abs(network.y_to_pu), np.abs(network.y_bus_pu)
    with np.errstate(invalid="ignore"):
        rules: tuple[tuple[tuple[str, ...], str, Floats, Bools, str], ...] = (
            (network.bus_names, "bus", vn_kv, (vn_kv > 0) & (vn_kv <= MAX_KV),
             f"vn_kv above 0, up to {MAX_KV:g}"),
            (network.bus_names, "bus", low, (low > 0) & np.isfinite(low), "v_min_pu above 0"),
            (network.bus_names, "bus", high, (high >= low) & np.isfinite(high),
             "v_max_pu of v_min_pu or more"),
            (network.line_names, "branch", r, np.isfinite(r), "r_pu that is a finite number"),
            (network.line_names, "branch", x, np.isfinite(x), "x_pu that is a finite number"),
            (network.line_names, "branch", network.tap,
             (network.tap > 1.0 / MAX_TAP) & (network.tap < MAX_TAP),
             f"a ratio between {1.0 / MAX_TAP:g} and {MAX_TAP:g} in per unit"),
            (network.line_names, "branch", charging, np.isfinite(charging),
             "charging that is a finite number"),
            (network.bus_names, "bus", shunt, np.isfinite(shunt), "a shunt of finite size"),
            (network.line_names, "branch", rating, rating > 0,
             "rating_mva above 0; no limit where there is none"),
            (network.line_names, "branch", angle_min, angle_min <= shift + ROUNDING_DEGREE,
             IDLE.format("min")),
            (network.line_names, "branch", angle_max, angle_max >= shift - ROUNDING_DEGREE,
             IDLE.format("max")),
        )  # fmt: skip
    for names, element, values, sound, allowed in rules:
        wrong = np.flatnonzero(~sound)
        if wrong.size:
            texts = [f"{names[k]}: {values[k]:g}" for k in wrong]
            yield key, few(element, texts), allowed, "mend these rows in the source"
    loops = np.flatnonzero(network.from_bus == network.to_bus)
    if loops.size:
        texts = [network.line_names[k] for k in loops]
        allowed = "two different buses at the ends of a branch"
        yield key, few("branch", texts), allowed, "take the branch out of the source"


def few(element: str, texts: Sequence[str]) -> str:
    """`branch 1-2: -0.1, 3-4: -0.2`, the first few of many."""
    more = f", ... ({len(texts)} in all)" if len(texts) > _FEW else ""
    return f"{element} {', '.join(texts[:_FEW])}{more}"
