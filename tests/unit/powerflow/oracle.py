"""pandapower, one member at a time, for any network, line status and set of roots."""

from __future__ import annotations

from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.case import Network


def oracle(
    network: Network, p: Floats, q: Floats, up: Any, root: Any, v: Floats
) -> tuple[Floats, float, Floats, Floats]:
    """Voltages (buses,) in pu, losses in MW, MVA (lines,), and MW of every root (buses,).

    All arguments are of one member: (buses,) and (lines,).
    """
    import pandapower as pp

    net = pp.create_empty_network(sn_mva=1.0)
    for vn_kv in network.vn_kv:
        pp.create_bus(net, vn_kv)
    for k, (i, j) in enumerate(zip(network.from_bus, network.to_bus, strict=True)):
        ohm = np.array([network.r_pu[k], network.x_pu[k]]) * network.vn_kv[i] ** 2
        pp.create_line_from_parameters(net, i, j, 1.0, *ohm, 0.0, 99.0, in_service=bool(up[k]))
    for bus in range(len(p)):
        pp.create_sgen(net, bus, p[bus], q[bus])
    for bus in np.flatnonzero(root).tolist():
        pp.create_ext_grid(net, bus, vm_pu=v[bus])
    pp.runpp(net, numba=False, tolerance_mva=1e-10, init="flat")
    flows = net.res_line.fillna(0.0)
    sent = np.hypot(flows.p_from_mw, flows.q_from_mvar)
    come = np.hypot(flows.p_to_mw, flows.q_to_mvar)
    fed = np.zeros(len(p))
    fed[net.ext_grid.bus] = net.res_ext_grid.p_mw
    volts = net.res_bus.vm_pu.to_numpy()
    return volts, float(flows.pl_mw.sum()), np.maximum(sent, come).to_numpy(), fed
