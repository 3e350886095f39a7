"""Independent oracles: the same microgrid written down a second time, by hand.

`linear_optimum` is a MILP for HiGHS, at copperplate or LinDistFlow; `ac_point` a nonlinear program
in rectangular voltages for Ipopt. Neither uses `resilience.models`, and neither has a limit beyond
those that a case states. Both read the arguments of `resilience.testing.small_case`, of which they
know what `random_document` draws.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.optimize import Bounds, LinearConstraint, milp

from resilience.arrays import Bools, Floats, Ints

Document = dict[str, Any]
KINDS = ("load", "pv", "ess", "generator", "grid")


def random_document(rng: np.random.Generator, *, ac: bool, scale: float) -> Document:
    """Anything that a case may state: profiles 0 to 2, bands down to 0.7, efficiencies from 0.5,
    prices of both signs, power that must be taken, tight ratings; powers of about `scale` MW.

    Args:
        rng: a fresh one for documents that can be drawn again.
        ac: ratings of inverters and lines, as discs; else blocks, and ratings of breakpoints.
        scale: MW.
    """
    buses, slots = int(rng.integers(2, 5)), 3
    step_min = float(rng.choice([15.0, 30.0, 60.0]))

    def bus() -> str:
        return str(rng.integers(1, buses + 1))

    def mw(low: float, high: float) -> float:
        return float(rng.uniform(low, high) * scale)

    def price(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 2)

    profiles = {f"p{k}": rng.uniform(0.0, 2.0, slots).round(3).tolist() for k in range(4)}
    profiles["price"] = rng.uniform(0.2, 1.8, slots).round(3).tolist()
    load: list[dict[str, Any]] = [
        {
            "bus": bus(), "p_max_mw": mw(0.2, 1.5), "profile": f"p{k}",
            "power_factor": float(rng.uniform(0.75, 0.99)), "shed_cost_per_mwh": price(3, 200),
            **({} if ac else {"block": bool(rng.random() < 0.2)}),
        }
        for k in range(rng.integers(1, 4))
    ]  # fmt: skip
    pv = []
    for _ in range(rng.integers(0, 3)):
        plant: dict[str, Any] = {
            "bus": bus(), "p_max_mw": mw(0.2, 1.5), "profile": "p3", "cost_per_mwh": price(-5, 5),
            "curtailable": bool(rng.random() < 0.8),
        }  # fmt: skip
        if ac and rng.random() < 0.5:
            plant |= {"s_mva": plant["p_max_mw"] * rng.uniform(0.9, 1.3), "curtailable": True}
        pv.append(plant)
    ess = []
    for _ in range(rng.integers(0, 2)):
        p_max = mw(0.2, 1.2)
        ess.append({
            "bus": bus(), "p_max_mw": p_max, "p_min_mw": -mw(0.2, 1.2), "e_mwh": mw(0.3, 2.0),
            "soc_initial": float(rng.uniform(0.1, 0.9)), "grid_forming": False,
            "efficiency_charge": float(rng.uniform(0.5, 0.99)),
            "efficiency_discharge": float(rng.uniform(0.5, 0.99)),
            "degradation_cost_per_mwh": price(0.1, 3),
        })  # fmt: skip
    has_grid = bool(rng.random() < 0.9)
    generator = [
        {
            "bus": bus(), "p_max_mw": mw(0.2, 1.5), "cost_per_mwh": price(2, 80),
            "q_min_mvar": -mw(0.1, 0.8), "q_max_mvar": mw(0.1, 0.8),
        }
        for _ in range(rng.integers(0, 2) if has_grid else 1)
    ]  # fmt: skip
    v_min, v_max = float(rng.choice([0.7, 0.8, 0.9, 0.95])), float(rng.choice([1.05, 1.1, 1.2]))
    grid = [
        {
            "import_max_mw": mw(0.5, 9.0), "import_cost_per_mwh": price(-10, 40),
            "export_max_mw": mw(0.5, 5.0) * float(rng.random() < 0.6),
            "export_cost_per_mwh": price(-60, 10), "price_profile": "price",
            "q_max_mvar": mw(1.0, 6.0), "v_pu": round(float(rng.uniform(0.97, v_max)), 3),
        }
        for _ in range(int(has_grid))
    ]  # fmt: skip
    peak = 2.0 * sum(table["p_max_mw"] for table in load)
    lines, line_tables, outages = [], [], []
    for j in range(2, buses + 1):
        i = int(rng.integers(1, j))
        drop = float(10.0 ** rng.uniform(-4, -0.7))
        lines.append((i, j, drop / peak, drop / peak * float(rng.uniform(0.2, 2.0))))
        table: Document = {"name": f"{i}-{j}", "breakpoint": bool(rng.random() < 0.5)}
        if rng.random() < 0.3 and (ac or table["breakpoint"]):
            table["rating_mva"] = mw(0.2, 2.0)
        line_tables.append(table)
        if rng.random() < 0.2:
            first, stop = step_min, step_min * int(rng.integers(2, slots + 1))
            outages.append(f"{i}-{j}@{_clock(first)}-{_clock(stop)}")
    return {
        "slots": slots, "step_min": step_min, "buses": buses, "lines": lines,
        "line_tables": line_tables, "outages": outages, "profiles": profiles,
        "terminal_value_per_mwh": price(0, 20), "voltage_band_pu": (v_min, v_max),
        "load": load, "pv": pv, "ess": ess, "generator": generator, "grid": grid,
    }  # fmt: skip


def _clock(minutes: float) -> str:
    return f"{int(minutes) // 60:02d}:{int(minutes) % 60:02d}"


@dataclass
class Scene:
    """What a document says of every slot.

    Attributes:
        document: arguments of `small_case`.
        up: (lines, slots) whether a line is there.
        alive: (buses, slots) whether a bus has a unit that forms its island.
        island: (buses, slots) least bus of the island.
        hours: length of a slot, h.
    """

    document: Document
    up: Bools
    alive: Bools
    island: Ints
    hours: float = field(init=False)

    def __post_init__(self) -> None:
        self.hours = self.document["step_min"] / 60.0

    @classmethod
    def of(cls, document: Document) -> Scene:
        """Reads outages, and finds islands by walking."""
        d, slots, n = document, document["slots"], document["buses"]
        up = np.ones((len(d["lines"]), slots), bool)
        for text in d["outages"]:
            name, _, span = text.partition("@")
            first, stop = (
                int((60 * int(t[:2]) + int(t[3:])) / d["step_min"]) for t in span.split("-")
            )
            k = [f"{i}-{j}" for i, j, _, _ in d["lines"]].index(name)
            up[k, first:stop] = False
        island = np.tile(np.arange(n)[:, None], (1, slots))
        for t in range(slots):
            for _ in range(n):
                for k, (i, j, _, _) in enumerate(d["lines"]):
                    if up[k, t]:
                        island[[i - 1, j - 1], t] = island[[i - 1, j - 1], t].min()
        units = d["generator"] + d["grid"]
        sources = [int(unit.get("bus", "1")) - 1 for unit in units]
        alive = np.zeros((n, slots), bool)
        for t in range(slots):
            alive[:, t] = np.isin(island[:, t], island[sources, t])
        return cls(d, up, alive, island)

    def profile(self, name: str) -> Floats:
        """(slots,) values of a profile."""
        return np.asarray(self.document["profiles"][name], float)

    def bus(self, table: Document) -> int:
        """Where a device stands."""
        return int(table.get("bus", "1")) - 1

    @property
    def turnover(self) -> float:
        """$ of all devices at full power, each at its price: the size of what may cancel."""
        d, total = self.document, 0.0
        for kind in KINDS:
            for table in d[kind]:
                prices = [abs(v) for k, v in table.items() if k.endswith("_per_mwh")]
                powers = [v for k, v in table.items() if k.endswith("_max_mw")]
                total += max(prices) * max(powers)
        return float(2.0 * total * self.hours * d["slots"])


@dataclass
class _Linear:
    """A MILP that grows column by column and row by row."""

    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    cost: list[float] = field(default_factory=list)
    whole: list[int] = field(default_factory=list)
    rows: list[tuple[dict[int, float], float, float]] = field(default_factory=list)
    offset: float = 0.0

    def column(self, lower: float, upper: float, cost: float = 0.0, whole: int = 0) -> int:
        self.lower.append(lower)
        self.upper.append(upper)
        self.cost.append(cost)
        self.whole.append(whole)
        return len(self.cost) - 1

    def row(self, terms: dict[int, float], low: float, high: float) -> None:
        self.rows.append((terms, low, high))

    def optimum(self) -> float:
        """$; inf where there is no point."""
        a = sp.lil_array((len(self.rows), len(self.cost)))
        for i, (terms, _, _) in enumerate(self.rows):
            for j, value in terms.items():
                a[i, j] = value
        sides = [(low, high) for _, low, high in self.rows]
        found = milp(
            self.cost,
            integrality=self.whole,
            bounds=Bounds(np.array(self.lower), np.array(self.upper)),
            constraints=LinearConstraint(a.tocsr(), *np.array(sides).T),
            options={"mip_rel_gap": 0.0},
        )
        return float(found.fun) + self.offset if found.x is not None else np.inf


def linear_optimum(  # noqa: C901, PLR0912 a list of devices, one after the other
    document: Document, *, voltages: bool, scale: float
) -> float:
    """$ of the best plan at LinDistFlow, or at copperplate without `voltages`; inf for none.

    Powers are in units of `scale` MW.
    """
    scene, m = Scene.of(document), _Linear()
    d, dt = document, scene.hours * scale
    n, slots = d["buses"], d["slots"]
    p: list[list[dict[int, float]]] = [[{} for _ in range(slots)] for _ in range(n)]
    q: list[list[dict[int, float]]] = [[{} for _ in range(slots)] for _ in range(n)]
    p0, q0 = np.zeros((n, slots)), np.zeros((n, slots))
    for table in d["load"]:
        b, tan = scene.bus(table), np.tan(np.arccos(table["power_factor"]))
        for t, pu in enumerate(scene.profile(table["profile"])):
            demand, price = table["p_max_mw"] * pu / scale, table["shed_cost_per_mwh"] * dt
            if not scene.alive[b, t]:
                m.offset += price * demand
                continue
            shed = m.column(0.0, demand, price)
            if table["block"]:
                m.row({shed: 1.0, m.column(0, 1, 0.0, 1): demand}, demand, demand)
            p[b][t][shed], q[b][t][shed] = 1.0, tan
            p0[b, t] -= demand
            q0[b, t] -= demand * tan
    for table in d["pv"]:
        b = scene.bus(table)
        for t, pu in enumerate(scene.profile(table["profile"])):
            most = table["p_max_mw"] * pu / scale * scene.alive[b, t]
            least = 0.0 if table["curtailable"] else most
            p[b][t][m.column(least, most, table["cost_per_mwh"] * dt)] = 1.0
    for table in d["generator"]:
        b = scene.bus(table)
        for t in range(slots):
            most = table["p_max_mw"] / scale
            p[b][t][m.column(0.0, most, table["cost_per_mwh"] * dt)] = 1.0
            limits = table["q_min_mvar"] / scale, table["q_max_mvar"] / scale
            q[b][t][m.column(*limits)] = 1.0
    for table in d["ess"]:
        _linear_storage(m, scene, table, p, scale)
    for table in d["grid"]:
        for t, factor in enumerate(scene.profile(table["price_profile"])):
            limits = table["import_max_mw"] / scale, table["export_max_mw"] / scale
            prices = table["import_cost_per_mwh"], table["export_cost_per_mwh"]
            bring, send = (
                m.column(0.0, limit, price * factor * dt)
                for limit, price in zip(limits, prices, strict=True)
            )
            _one_of_two(m, bring, send, *limits)
            p[0][t] |= {bring: 1.0, send: -1.0}
            q_max = table["q_max_mvar"] / scale
            q[0][t][m.column(-q_max, q_max)] = 1.0
    _wires(m, scene, p, q, voltages, scale)
    for b in range(n):
        for t in range(slots):
            m.row(p[b][t], -p0[b, t], -p0[b, t])
            if voltages:
                m.row(q[b][t], -q0[b, t], -q0[b, t])
    return m.optimum()


def _one_of_two(m: _Linear, a: int, b: int, a_max: float, b_max: float) -> None:
    side = m.column(0, 1, 0.0, 1)
    m.row({a: 1.0, side: -a_max}, -np.inf, 0.0)
    m.row({b: 1.0, side: b_max}, -np.inf, b_max)


def _linear_storage(
    m: _Linear, scene: Scene, table: Document, p: list[list[dict[int, float]]], scale: float
) -> None:
    b, dt, size = scene.bus(table), scene.hours, table["e_mwh"] / scale
    before: int | None = None
    for t in range(scene.document["slots"]):
        alive = float(scene.alive[b, t])
        limits = table["p_max_mw"] / scale * alive, -table["p_min_mw"] / scale * alive
        charge = m.column(0.0, limits[0])
        wear = table["degradation_cost_per_mwh"] * dt * scale
        discharge = m.column(0.0, limits[1], wear)
        _one_of_two(m, charge, discharge, *limits)
        last = t == scene.document["slots"] - 1
        worth = scene.document["terminal_value_per_mwh"] * scale if last else 0.0
        after = m.column(0.0, size, -worth)
        row = {
            after: 1.0,
            charge: -dt * table["efficiency_charge"],
            discharge: dt / table["efficiency_discharge"],
        }
        start = size * table["soc_initial"] if before is None else 0.0
        m.row(row if before is None else row | {before: -1.0}, start, start)
        p[b][t] |= {discharge: 1.0, charge: -1.0}
        before = after


def _wires(
    m: _Linear,
    scene: Scene,
    p: list[list[dict[int, float]]],
    q: list[list[dict[int, float]]],
    voltages: bool,
    scale: float,
) -> None:
    d = scene.document
    low, high = (v**2 for v in d["voltage_band_pu"])
    held = d["grid"][0]["v_pu"] ** 2 if d["grid"] else None
    for t in range(d["slots"]):
        v = [
            m.column(held, held) if b == 0 and held is not None else m.column(low, high)
            for b in range(d["buses"])
        ]
        for k, (i, j, r, x) in enumerate(d["lines"]):
            if not scene.up[k, t]:
                continue
            rating = d["line_tables"][k].get("rating_mva", np.inf) / scale
            limit = np.inf if voltages else rating
            flow = m.column(-limit, limit)
            p[i - 1][t][flow], p[j - 1][t][flow] = -1.0, 1.0
            if voltages:
                reactive = m.column(-np.inf, np.inf)
                q[i - 1][t][reactive], q[j - 1][t][reactive] = -1.0, 1.0
                drop = {v[j - 1]: 1.0, v[i - 1]: -1.0}
                m.row(drop | {flow: 2 * r * scale, reactive: 2 * x * scale}, 0.0, 0.0)


def ac_point(document: Document, *, scale: float) -> float:
    """$ of a plan that satisfies the AC equations, a local optimum; inf where Ipopt found none.

    Voltages are rectangular, powers in units of `scale` MW. One mode at a time holds in the answer:
    where both sides of a unit act, it is solved again with the smaller one held at zero.
    """
    closed: set[tuple[int, str]] = set()
    for _ in range(4):
        cost, both = _ac_solution(document, scale, closed)
        if not both:
            return cost
        closed |= both
    return np.inf


def _ac_solution(  # noqa: C901, PLR0912, PLR0915 a list of devices, one after the other
    document: Document, scale: float, closed: set[tuple[int, str]]
) -> tuple[float, set[tuple[int, str]]]:
    import casadi as ca

    scene, d = Scene.of(document), document
    dt, n = scene.hours * scale, d["buses"]
    x: list[Any] = []
    box: list[tuple[float, float, float]] = []
    rows: list[tuple[Any, float, float]] = []
    pairs: list[tuple[int, int, str]] = []
    cost: Any = 0.0

    def column(low: float, high: float, start: float | None = None) -> Any:
        x.append(ca.SX.sym(f"x{len(x)}"))
        box.append((low, high, 0.5 * (low + high) if start is None else start))
        return x[-1]

    def pair(name: str, up: float, down: float) -> tuple[Any, Any]:
        sides = [
            column(0.0, 0.0 if (k, name) in closed else limit) for k, limit in enumerate((up, down))
        ]
        pairs.append((len(x) - 2, len(x) - 1, name))
        return sides[0], sides[1]

    band = d["voltage_band_pu"]
    held = d["grid"][0]["v_pu"] if d["grid"] else None
    stored: dict[int, Any] = {}
    for t in range(d["slots"]):
        p: list[Any] = [0.0] * n
        q: list[Any] = [0.0] * n
        e, f = [], []
        for b in range(n):
            root = scene.island[b, t] == b
            start = held if held is not None else 1.0
            e.append(column(-2.0, 2.0, start))
            f.append(column(0.0, 0.0) if root else column(-2.0, 2.0, 0.0))
            low, high = (held, held) if b == 0 and held is not None else band
            rows.append((e[b] ** 2 + f[b] ** 2, low**2, high**2))
        for table in d["load"]:
            b, tan = scene.bus(table), np.tan(np.arccos(table["power_factor"]))
            demand = table["p_max_mw"] * scene.profile(table["profile"])[t] / scale
            shed = column(0.0 if scene.alive[b, t] else demand, demand)
            cost += table["shed_cost_per_mwh"] * dt * shed
            p[b] += shed - demand
            q[b] += tan * (shed - demand)
        for table in d["pv"]:
            b = scene.bus(table)
            most = table["p_max_mw"] * scene.profile(table["profile"])[t] / scale
            most *= scene.alive[b, t]
            fed = column(0.0 if table["curtailable"] else most, most)
            cost += table["cost_per_mwh"] * dt * fed
            p[b] += fed
            if "s_mva" in table and scene.alive[b, t]:
                s = table["s_mva"] / scale
                reactive = column(-s, s)
                rows.append((fed**2 + reactive**2, -np.inf, s**2))
                q[b] += reactive
        for table in d["generator"]:
            b = scene.bus(table)
            fed = column(0.0, table["p_max_mw"] / scale)
            cost += table["cost_per_mwh"] * dt * fed
            p[b] += fed
            q[b] += column(table["q_min_mvar"] / scale, table["q_max_mvar"] / scale)
        for k, table in enumerate(d["ess"]):
            b, alive = scene.bus(table), float(scene.alive[scene.bus(table), t])
            limits = table["p_max_mw"] / scale * alive, -table["p_min_mw"] / scale * alive
            charge, discharge = pair(f"ess{k}, {t}", *limits)
            cost += table["degradation_cost_per_mwh"] * dt * discharge
            size = table["e_mwh"] / scale
            now = stored.get(k, size * table["soc_initial"])
            stored[k] = column(0.0, size)
            gain = table["efficiency_charge"] * charge
            drain = discharge / table["efficiency_discharge"]
            rows.append((stored[k] - now - scene.hours * (gain - drain), 0.0, 0.0))
            p[b] += discharge - charge
        for table in d["grid"]:
            factor = scene.profile(table["price_profile"])[t]
            limits = table["import_max_mw"] / scale, table["export_max_mw"] / scale
            bring, send = pair(f"grid, {t}", *limits)
            cost += factor * dt * table["import_cost_per_mwh"] * bring
            cost += factor * dt * table["export_cost_per_mwh"] * send
            p[0] += bring - send
            q[0] += column(-table["q_max_mvar"] / scale, table["q_max_mvar"] / scale)
        for k, (i, j, r, reactance) in enumerate(d["lines"]):
            if not scene.up[k, t]:
                continue
            y = 1.0 / complex(r * scale, reactance * scale)
            for a, b in ((i - 1, j - 1), (j - 1, i - 1)):
                de, df = e[a] - e[b], f[a] - f[b]
                current = y.real * de - y.imag * df, y.real * df + y.imag * de
                sent = (
                    e[a] * current[0] + f[a] * current[1],
                    f[a] * current[0] - e[a] * current[1],
                )
                p[a] -= sent[0]
                q[a] -= sent[1]
                rating = d["line_tables"][k].get("rating_mva")
                if rating is not None:
                    rows.append((sent[0] ** 2 + sent[1] ** 2, -np.inf, (rating / scale) ** 2))
        rows += [(power, 0.0, 0.0) for power in (*p, *q) if isinstance(power, ca.SX)]
    for energy in stored.values():
        cost -= d["terminal_value_per_mwh"] * scale * energy
    size = max(scene.turnover, 1e-300)
    sides, bounds = np.array([row[1:] for row in rows]), np.array(box)
    nlp: dict[str, Any] = {
        "x": ca.vertcat(*x),
        "f": cost / size,
        "g": ca.vertcat(*(row[0] for row in rows)),
    }
    options: dict[str, Any] = {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 800}
    solver = ca.nlpsol("ac", "ipopt", nlp, {"ipopt": options, "print_time": False})
    found = solver(
        x0=bounds[:, 2], lbx=bounds[:, 0], ubx=bounds[:, 1], lbg=sides[:, 0], ubg=sides[:, 1]
    )
    if not solver.stats()["success"]:
        return np.inf, set()
    z = np.asarray(found["x"]).ravel()
    both = {(int(z[a] >= z[b]), name) for a, b, name in pairs if min(z[a], z[b]) > 1e-6}
    return float(found["f"]) * size, both
