"""Limits of currents in meshes: never less than what any voltages drive, and known dividers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.case.networks.network import Network
from resilience.models.network import circuit
from resilience.models.network.circuit import circuit_currents, shares
from resilience.models.network.limits import short_circuit
from resilience.models.wiring import LOSSLESS_ROOM
from resilience.testing import small_case
from tests.known.solving import solved

BUSES = 6


def network(ends: list[tuple[int, int]], z: Any, ratio: Any = 1.0) -> Network:
    """Buses from 0, impedances and ratios of any sign and angle."""
    buses = max(max(pair) for pair in ends) + 1
    plain = small_case(
        buses=buses,
        lines=[(i + 1, j + 1, 0.1, 0.1) for i, j in ends],
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 1.0}],
        grid=[{"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}],
    ).network
    z = np.asarray(z, complex) * np.ones(len(ends))
    ratio = np.asarray(ratio, complex) * np.ones(len(ends))
    return replace(plain, r_pu=z.real.copy(), x_pu=z.imag.copy(), ratio=ratio)


def random_mesh(rng: np.random.Generator, kind: str) -> Network:
    """A tree and three lines more, some of them parallel to others."""
    ends = [(int(rng.integers(k)), k) for k in range(1, BUSES)]
    ends += [tuple(rng.choice(BUSES, 2, replace=False).tolist()) for _ in range(3)]
    n = len(ends)
    z = rng.uniform(0.01, 0.2, n) + 1j * rng.uniform(0.01, 0.2, n)
    if kind == "any sign":
        z = z.real * rng.choice([1.0, 1.0, -0.2], n) + 1j * z.imag * rng.choice([1.0, -1.0], n)
    if kind != "ratios":
        return network(ends, z)
    tap = rng.choice([1.0, 1.0, 0.97, 1.03], n)
    return network(ends, z, tap * np.exp(1j * rng.choice([0.0, 0.0, 0.03], n)))


def flows(mesh: Network, volts: Any, up: Any) -> tuple[Floats, Floats]:
    """(lines,) currents of impedances, and (buses,) what is drawn, of complex voltages."""
    behind = volts[mesh.from_bus] / mesh.ratio - volts[mesh.to_bus]
    current = np.where(up, behind / (mesh.r_pu + 1j * mesh.x_pu), 0.0)
    drawn = np.zeros(len(volts), complex)
    np.add.at(drawn, mesh.from_bus, current / mesh.ratio.conj())
    np.add.at(drawn, mesh.to_bus, -current)
    return np.abs(current), np.abs(drawn)


@pytest.mark.parametrize("kind", ["one sign", "any sign", "ratios"])
def test_no_voltages_drive_more(kind: str) -> None:
    """Any voltages draw currents at the buses: with these alone known, no line has more."""
    rng, tight = np.random.default_rng(7), 0
    for _ in range(60):
        mesh = random_mesh(rng, kind)
        may_be_out = rng.random(len(mesh.r_pu)) < 0.4
        up = ~(may_be_out & (rng.random(len(mesh.r_pu)) < 0.5))
        volts = rng.uniform(0.9, 1.1, BUSES) * np.exp(0.3j * rng.normal(size=BUSES))
        current, drawn = flows(mesh, volts, up)
        limits = circuit_currents(mesh, may_be_out, drawn[:, None], np.abs(volts))
        if limits is None:
            assert kind == "ratios"
            continue
        assert (current <= limits[:, 0] * (1.0 + 1e-6) + 1e-9).all()
        assert (current <= short_circuit(mesh, np.abs(volts)) * (1.0 + 1e-9)).all()
        tight += int((limits[:, 0] <= drawn.sum()).all())
    assert tight > (20 if kind == "one sign" else 0)


@pytest.mark.parametrize(
    ("kind", "room"), [("one sign", 1.0), ("any sign", 1.0), ("ratios", LOSSLESS_ROOM)]
)
def test_no_lossless_voltages_drive_more_power(kind: str, room: float) -> None:
    """Squared voltages and angles drive P and Q alike: z (P - jQ) = (v_i - v_j) / 2 + j theta.

    Ratios part the two, a tap by its square and an angle by itself, for which there is room.
    """
    rng, tight = np.random.default_rng(11), 0.0
    for _ in range(100):
        mesh = random_mesh(rng, kind)
        v_sq, theta = rng.uniform(0.81, 1.21, BUSES), 0.3 * rng.normal(size=BUSES)
        i, j, tap = mesh.from_bus, mesh.to_bus, mesh.tap
        drop = 0.5 * (v_sq[i] / tap**2 - v_sq[j])
        turn = (theta[i] - theta[j] - np.angle(mesh.ratio)) / tap
        power = ((drop + 1j * turn) / (mesh.r_pu + 1j * mesh.x_pu)).conj()
        drawn = np.zeros(BUSES, complex)
        np.add.at(drawn, i, power)
        np.add.at(drawn, j, -power)
        none_out = np.zeros(len(power), bool)
        limits = circuit_currents(mesh, none_out, np.abs(drawn)[:, None], np.full(BUSES, 1.1))
        assert limits is not None
        assert (np.abs(power) <= room * limits[:, 0] * (1.0 + 1e-6) + 1e-9).all()
        tight = max(tight, float((np.abs(power) / np.maximum(limits[:, 0], 1e-9)).max()))
    assert tight > 0.99


def test_of_impedances_of_one_angle_no_line_has_more_than_half_of_what_is_drawn() -> None:
    mesh = network([(0, 1), (1, 2), (2, 0), (0, 2)], np.array([1.0, 2.0, 0.5, 0.7]) * (0.1 + 0.2j))
    drawn = np.array([[1.0], [0.7], [0.9]])
    limits = circuit_currents(mesh, np.zeros(4, bool), drawn, np.ones(3))
    assert limits is not None
    assert (limits <= 0.5 * drawn.sum() + 1e-9).all()


def test_a_bridge_has_what_one_side_draws() -> None:
    """A ring of three with a line to a fourth bus, which draws 0.2 of the 5.2."""
    mesh = network([(0, 1), (1, 2), (2, 0), (2, 3)], 0.1j)
    drawn = np.array([[3.0, 1.0], [1.0, 0.0], [1.0, 0.0], [0.2, 0.0]])
    limits = circuit_currents(mesh, np.zeros(4, bool), drawn, np.ones(4))
    assert limits is not None
    assert limits[3] == pytest.approx([0.2, 0.0], abs=1e-9)


@pytest.mark.parametrize(("x", "factor"), [(0.9, 0.9 / 1.9), (-0.5, 1.0), (-0.9, 9.0)])
def test_a_divider_of_reactances_of_both_signs(x: float, factor: float) -> None:
    """Of what flows from bus 0 to 2 the line of 1j takes x / (1 + x): 9 times of it, and back."""
    mesh = network([(0, 2), (0, 1), (1, 2)], [1j, 0.5j * x, 0.5j * x])
    drawn = np.array([[1.0], [0.0], [1.0]])
    limits = circuit_currents(mesh, np.zeros(3, bool), drawn, np.ones(3))
    assert limits is not None
    assert limits[0, 0] == pytest.approx(factor, rel=1e-6)


def test_what_ratios_drive_is_their_voltage_over_the_loop() -> None:
    """Nothing is drawn: 1 / 0.95 - 1 of 1 pu over 0.3 pu go round."""
    mesh = network([(0, 1), (1, 2), (2, 0)], 0.1j, [0.95, 1.0, 1.0])
    limits = circuit_currents(mesh, np.zeros(3, bool), np.zeros((3, 1)), np.ones(3))
    assert limits is not None
    driven = (1.0 / 0.95 - 1.0) / 0.3
    assert (limits > 0.9 * driven).all()
    assert (limits < 1.2 * driven).all()


def test_too_many_sets_of_lines_out_are_not_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = network([(0, 1), (1, 2), (2, 0)], 0.1j)
    every, drawn = np.ones(3, bool), np.ones((3, 1))
    assert circuit_currents(mesh, every, drawn, np.ones(3)) is not None
    monkeypatch.setattr(circuit, "MAX_SETS", 7)
    assert circuit_currents(mesh, every, drawn, np.ones(3)) is None
    assert circuit_currents(mesh, ~every, drawn, np.ones(3)) is not None


def test_parallel_lines_of_both_signs_share_more_than_there_is() -> None:
    """1j beside -0.9j: 9 and 10 times of it where 2j is out, which takes most where none is."""
    share = shares(network([(0, 1), (1, 0), (0, 1), (1, 2)], [1j, -0.9j, 2j, 0.1 + 0.1j]))
    y = 1.0 / np.array([1.0, -0.9, 2.0])
    assert share[:2] == pytest.approx([abs(y[0] / (y[0] + y[1])), abs(y[1] / (y[0] + y[1]))])
    assert share[2] == pytest.approx(abs(y[2] / y.sum()))
    assert share[3] == 1.0


@pytest.mark.parametrize("method", ["lp", "nlp", "minlp"])
def test_parallel_lines_of_both_signs_are_planned_and_carried(method: str) -> None:
    """4 and 5 times the load in the first hour, all of it in the one that is up in the second."""
    case = small_case(
        slots=2,
        buses=2,
        lines=[(1, 2, 0.0, 0.1, {"name": "a"}), (1, 2, 0.0, 0.1, {"name": "b"})],
        line_tables=[{"name": "a", "breakpoint": True}, {"name": "b", "breakpoint": True}],
        outages=["b@01:00-02:00"],
        load=[{"bus": "2", "p_max_mw": 0.2, "shed_cost_per_mwh": 1000.0}],
        generator=[{"bus": "2", "p_max_mw": 0.0, "q_min_mvar": -0.1, "q_max_mvar": 0.1}],
        grid=[{"import_max_mw": 0.22, "q_max_mvar": 0.2, "import_cost_per_mwh": 20.0}],
    )
    case = replace(case, network=replace(case.network, x_pu=np.array([0.1, -0.08])))
    found = solved(case, method)
    assert found.violation < 1e-6
    assert found["load.shed"].sum() == pytest.approx(0.0, abs=1e-6)
    assert np.abs(found["line.p"]) == pytest.approx(np.array([[0.8, 0.2], [1.0, 0.0]]), rel=1e-3)
    assert max(found.near_limits.values(), default=0.0) == 0.0


@pytest.mark.parametrize("max_sets", [circuit.MAX_SETS, 0])
@pytest.mark.parametrize("method", ["lp", "nlp", "minlp"])
def test_a_loop_of_both_signs_is_planned_and_carried(
    method: str, max_sets: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five times what is drawn goes round: limits of twice that left no plan.

    Lines of 0.04 pu twice and of -0.1 make a loop of -0.02; the first two take 5 times the load.
    Where nothing tells the circuit, voltages and angles limit it, and the plan says so.
    """
    monkeypatch.setattr(circuit, "MAX_SETS", max_sets)
    case = small_case(
        slots=1,
        buses=3,
        lines=[(1, 2, 0.0, 0.04), (2, 3, 0.0, 0.04), (1, 3, 0.0, 0.1)],
        load=[{"bus": "3", "p_max_mw": 0.3, "shed_cost_per_mwh": 1000.0}],
        generator=[{"bus": "3", "p_max_mw": 0.0, "q_min_mvar": -0.2, "q_max_mvar": 0.2}],
        grid=[{"import_max_mw": 0.33, "q_max_mvar": 0.2, "import_cost_per_mwh": 20.0}],
    )
    case = replace(case, network=replace(case.network, x_pu=np.array([0.04, 0.04, -0.1])))
    found = solved(case, method)
    assert found.violation < 1e-6
    assert found["load.shed"].sum() == pytest.approx(0.0, abs=1e-6)
    assert np.abs(found["line.p"][0]) == pytest.approx([5.0 * 0.3], rel=1e-3)
    assert np.abs(found["line.p"][2]) == pytest.approx([4.0 * 0.3], rel=1e-3)
    assert max(found.near_limits.values(), default=0.0) == 0.0
    plan = rs.solve(case, method)
    assert isinstance(plan, rs.Plan)
    assert any("not proven here" in note for note in plan.notes) == (max_sets == 0)
    if method != "lp":
        assert rs.ac_check_plan(plan).ok
