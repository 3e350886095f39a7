"""What the source paper prints, and what it leaves open.

Wu, Chiu, Tsai, Liu, Hua: Multiagent reinforcement learning in enhancing resilience of microgrids
under extreme weather events. Expert Systems with Applications, 2025,
doi:10.1016/j.eswa.2025.129145.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """A row of the paper's tables; None where it prints nothing.

    Attributes:
        average: operating cost of a day, $.
        highest: the dearest day, $.
        lowest: the cheapest day, $.
        shed_mw: MW of load shed on a day, added up over its slots.
        time_s: "computation time", s.
    """

    average: float | None = None
    highest: float | None = None
    lowest: float | None = None
    shed_mw: float | None = None
    time_s: float | None = None


RULE = Published(41.51, 46.42, 31.69, 0.0, 513.67)
MINLP = Published(35.06, 45.08, 25.15, 4.12, 3632.48)
DDPG = Published(37.71, 44.67, 28.54, 2.94, 527.07)
MAPPO = Published(35.64, 51.07, 27.87, 0.96, 966.20)
PROPOSED = Published(35.18, 42.17, 25.83, 1.72, 529.63)
FAILED = {
    0: Published(35.18, 42.17, 25.83, 1.72),
    1: Published(37.16, 42.63, 26.63, 1.57),
    3: Published(37.95, 42.81, 26.65, 1.55),
}
"""Of the proposed method, by the number of agents that have failed."""
SHED_PRICE = {
    0.15: Published(shed_mw=3.4),
    1.5: Published(shed_mw=3.15),
    30.0: Published(shed_mw=2.84),
}
"""Of the proposed method, by the price of load shedding, $/MWh."""
DEVIATION = Published(lowest=27.47, shed_mw=2.77)
"""Of the proposed method, with 15 % less PV and 15 % more load than forecast."""
MESH = Published(highest=241.9)
"""Of the proposed method, in the IEEE 14-bus network."""

OPEN = (
    ("profiles", "which zone, scaled how", "per unit of each column's maximum"),
    ("buses of the devices", "not in the text", "those of the case, with the reason for each"),
    ("breakpoints", "which lines", "main supply and heads of the laterals; a cut set of the mesh"),
    ("bell", "height and width", "0.8 outages a day and line, 4 slots wide, see [outage]"),
    ("initial state of charge", "not said", "0.5 on the first day, then carried over"),
    ("energy left at the end", "no worth", "the case's terminal value; not in the daily costs"),
    ("generators, eq. 20", "also beside the grid?", "in islands only"),
    ("training", "its own recourse", "with the economic one; both judge what came out"),
    ("share of load shed, eq. 21", "beyond 0 and 1?", "clipped; PV is curtailed first"),
    ("surplus PV", "no curtailment in the balance", "curtailed"),
    ("shedding in MW", "of slots or of hours", "both are printed; its MW are sums over slots"),
    ("MINLP", "what it assumes of outages", "mpc-blind: none to come, present ones stay; 2 h"),
    ("failed agents", "which, and what they do", "the first units of the case, which stand idle"),
    ("PV -15 %, load +15 %", "noticed or not", "observed when it happens, never expected"),
    ("replay, noise, optimiser", "not said", "see the module maddpg_paper"),
    ("eq. 20 of the critic", "ascends its loss", "descends"),
    ("computation time", "of what", "training, decisions and power flow are separate"),
    ("seeds and storms", "one curve is shown", "several of both, with intervals"),
)
"""A setting, what the paper leaves open about it, and what is done here."""
