"""Case files: reading, checking and writing them.

A case file is TOML: a network, devices, a horizon and profiles. `load_case` turns it into an
immutable `Case`, or reports every mistake in it at once.
"""

from resilience.case.data import Case, Outage
from resilience.case.document import case_names
from resilience.case.load import load_case
from resilience.case.networks.network import Network
from resilience.case.outages import parse_outages
from resilience.case.schema import (
    DeviceKind,
    DeviceTable,
    ESSTable,
    GeneratorTable,
    GridTable,
    LoadTable,
    OutageTable,
    PVTable,
    TankTable,
    case_schema,
    register_device,
    unregister_device,
)
from resilience.case.starter import new_case_text
from resilience.case.write import case_text

__all__ = [
    "Case",
    "DeviceKind",
    "DeviceTable",
    "ESSTable",
    "GeneratorTable",
    "GridTable",
    "LoadTable",
    "Network",
    "Outage",
    "OutageTable",
    "PVTable",
    "TankTable",
    "case_names",
    "case_schema",
    "case_text",
    "load_case",
    "new_case_text",
    "parse_outages",
    "register_device",
    "unregister_device",
]
