"""AC power flow in batches against pandapower, one flow at a time: 33 buses, random injections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.row import Row, ratio, timed
from resilience.case import Network, load_case
from resilience.models.network.powerflow import Flow, flow

BATCH, SINGLE, ROUNDS = 4096, 10, 5
HEADS = {"2-19": "19", "3-23": "23", "6-26": "26"}  # breakpoint: root of the island behind it
OUT_SHARE = 0.05  # share of the lines out where any line can fail
AGREEMENT_PU = 1e-6


@dataclass(frozen=True)
class Members:
    """Arguments of `flow`, (.., members)."""

    p: Any
    up: Any
    root: Any

    def flow(self, network: Network) -> Flow:
        return flow(network, self.p, 0.5 * self.p, self.up, self.root)


def flows() -> Iterator[Row]:
    network = load_case("ieee33").network
    rng = np.random.default_rng(0)
    breakpoints = [network.line(name) for name in HEADS]
    out = np.zeros((len(network.line_names), BATCH), bool)
    yield _row("AC flows/s, one topology", network, _members(network, rng, out), 500)
    out[breakpoints] = rng.random((len(breakpoints), BATCH)) < 0.5
    yield _row("AC flows/s, three breakpoints", network, _members(network, rng, out), 100)
    out = rng.random((len(network.line_names), BATCH)) < OUT_SHARE
    yield _row("AC flows/s, any line out", network, _members(network, rng, out), 100)


def _members(network: Network, rng: np.random.Generator, out: Any) -> Members:
    up = network.in_service[:, None] & ~out
    root = np.zeros((len(network.bus_names), BATCH), bool)
    root[0] = True
    for line, head in HEADS.items():
        root[network.bus(head)] = ~up[network.line(line)]
    return Members(rng.uniform(-0.3, 0.15, root.shape), up, root)


def _row(name: str, network: Network, members: Members, min_ratio: float) -> Row:
    """Both sides start from arrays; pandapower's net is built beforehand, and only changed."""
    peer, slow, fast = Peer(network), [], []
    for turn in range(ROUNDS):
        seconds, batch = timed(members.flow, network)
        fast.append(seconds / BATCH)
        some = range(turn * SINGLE, (turn + 1) * SINGLE)
        seconds, volts = timed(lambda chosen=some: [peer.voltage(members, k) for k in chosen])
        slow.append(seconds / SINGLE)
        for k, v in zip(some, volts, strict=True):
            np.testing.assert_allclose(batch.v_pu[:, k], v, atol=AGREEMENT_PU, rtol=0)
    row = ratio(name, slow, fast, min_ratio)
    rate = [1.0 / float(np.median(times)) for times in (fast, slow)]
    patterns = np.unique(np.concatenate([members.up, members.root]), axis=1).shape[1]
    note = f"{rate[0]:,.0f} against {rate[1]:,.0f} flows/s; {patterns} patterns in {BATCH:,}"
    return Row(row.name, row.measured, row.target, row.met, note)


class Peer:
    """The same network in pandapower, without numba, which is no faster at this size."""

    def __init__(self, network: Network) -> None:
        import pandapower as pp

        self.net = pp.create_empty_network(sn_mva=1.0)
        heads = [0, *(network.bus(head) for head in HEADS.values())]
        for vn_kv in network.vn_kv:
            pp.create_bus(self.net, vn_kv)
        for k, (i, j) in enumerate(zip(network.from_bus, network.to_bus, strict=True)):
            ohm = np.array([network.r_pu[k], network.x_pu[k]]) * network.vn_kv[i] ** 2
            pp.create_line_from_parameters(self.net, i, j, 1.0, *ohm, 0.0, 99.0)
        for bus in range(len(network.bus_names)):
            pp.create_sgen(self.net, bus, 0.0, 0.0)
        for bus in heads:
            pp.create_ext_grid(self.net, bus)
        self.heads = heads

    def voltage(self, members: Members, k: int) -> Any:
        import pandapower as pp

        net = self.net
        net.line["in_service"] = members.up[:, k]
        net.ext_grid["in_service"] = members.root[self.heads, k]
        net.sgen["p_mw"], net.sgen["q_mvar"] = members.p[:, k], 0.5 * members.p[:, k]
        pp.runpp(net, numba=False)
        return net.res_bus.vm_pu.to_numpy()
