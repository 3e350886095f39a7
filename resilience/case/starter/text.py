"""The text of a first case file: head, devices, and examples to fill in."""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from resilience.case.networks.feeder import V_MAX_PU, V_MIN_PU, FeederError
from resilience.case.networks.network import Network
from resilience.case.networks.omissions import Omission
from resilience.case.networks.read import READERS, read_feeder
from resilience.case.schema import NetworkTable
from resilience.case.starter.devices import device_tables
from resilience.errors import UsageError

_HEAD = """\
# A case for the network {title}. Loads and sources are the network's own; prices that it does
# not state, horizon and everything in comments are yours to set. `resilience case schema` lists
# every key.
{omissions}
name = {name}
description = ""

# Lines that a storm takes out, for example ["{line}@14:00-17:30"].
outages = []

[network]
{source}
{limits}

[time]
start = 2016-07-12T00:00:00
slots = 96
step_min = 15

# Time series in per unit of each device's peak: a file whose first column is `time`, in steps of
# step_min. Devices name their column with `profile = "..."`.
# [profiles]
# file = "profiles.csv"

[defaults.load]
shed_cost_per_mwh = 1000.0
"""

_EXAMPLES = """
# A storage system: at most 1 MW either way, 4 MWh. s_mva is its inverter's rating: without it the
# unit feeds no reactive power, which loads need when the grid is gone.
# [[ess]]
# name = "ess1"
# bus = {bus}
# p_max_mw = 1.0
# e_mwh = 4.0
# soc_min = 0.1
# soc_max = 0.9
# efficiency_charge = 0.95
# efficiency_discharge = 0.95
# s_mva = 1.1

# A diesel generator.
# [[generator]]
# name = "diesel1"
# bus = {bus}
# p_max_mw = 1.0
# q_max_mvar = 0.75
# cost_per_mwh = 300.0
"""


_NO_LIMITS = """\
v_min_pu = 0.9
v_max_pu = 1.1"""
_OWN_LIMITS = """\
# Every bus has the voltage limits of the network file; these keys would replace them all.
# v_min_pu = 0.9
# v_max_pu = 1.1"""


@dataclass(frozen=True)
class Starter:
    """A first case file.

    Attributes:
        text: TOML that loads.
        omissions: what of the network is not in it.
    """

    text: str
    omissions: tuple[Omission, ...]


def new_case_text(network: str) -> str:
    """A case file, as TOML that loads, for a pandapower network or a network file.

    Args:
        network: a function of `pandapower.networks` (`case33bw`) or the path of a pandapower
            `.json` or MATPOWER `.m` file.

    Raises:
        UsageError: it cannot be read.
    """
    return starter(network).text


def starter(network: str, folder: Path | None = None) -> Starter:
    """A first case file, and what of the network it leaves out.

    Args:
        network: as for `new_case_text`.
        folder: where the case file will lie; a network file there or below is named from there.

    Raises:
        UsageError: the network cannot be read.
    """
    path = Path(network)
    is_file = path.suffix in READERS
    ref = _file_ref(path, folder) if is_file else network
    table = NetworkTable(file=str(path.resolve())) if is_file else NetworkTable(pandapower=network)
    try:
        feeder = read_feeder(table)
    except FeederError as error:
        texts = [f"{value} found; allowed: {allowed}" for _, value, allowed, _ in error.findings]
        hint = error.findings[0][-1]
        raise UsageError(f"network {network!r}: " + "\n".join(texts), hint) from None
    tables, more = device_tables(feeder)
    omissions = (*feeder.omissions, *more)
    head = _HEAD.format(
        title=network,
        name=quote(path.stem if is_file else network),
        source=f"{'file' if is_file else 'pandapower'} = {quote(ref)}",
        omissions=_comment(omissions),
        limits=_OWN_LIMITS if _has_limits(feeder.network) else _NO_LIMITS,
        line=next(iter(feeder.network.line_names), "1-2"),
    )
    examples = _EXAMPLES.format(bus=quote(next(reversed(feeder.network.bus_names), "1")))
    return Starter(head + tables + examples, omissions)


def quote(text: str) -> str:
    """Text as TOML writes it."""
    return json.dumps(text, ensure_ascii=False)


def _file_ref(path: Path, folder: Path | None) -> str:
    full = path.resolve()
    inside = folder is not None and full.is_relative_to(folder.resolve())
    return os.path.relpath(full, folder.resolve()) if folder and inside else str(full)


def _has_limits(network: Network) -> bool:
    """Whether the source states voltage limits other than those that hold anyway."""
    ours = (network.v_min_pu == V_MIN_PU) & (network.v_max_pu == V_MAX_PU)
    return not bool(np.all(ours))


def _comment(omissions: Iterable[Omission]) -> str:
    """What is left out, as comment lines; nothing where there is nothing."""
    lines = [
        wrapped
        for omission in omissions
        for wrapped in textwrap.wrap(str(omission), 94, initial_indent="- ", subsequent_indent="  ")
    ]
    return (
        "\n".join(["#", "# Of the network, not in this case:", *(f"# {x}" for x in lines), ""])
        if lines
        else ""
    )
