"""The tables of a case file; their JSON Schema is the reference of the format."""

from resilience.case.schema.devices import (
    DeviceTable,
    ESSTable,
    GeneratorTable,
    GridTable,
    LoadTable,
    PVTable,
)
from resilience.case.schema.fields import Table
from resilience.case.schema.registry import (
    DEVICES,
    DeviceKind,
    case_schema,
    case_table,
    defaults_table,
    register_device,
    unregister_device,
)
from resilience.case.schema.storm import (
    CloudTable,
    CurveTable,
    ForecastTable,
    GeographyTable,
    RepairTable,
    StormTable,
)
from resilience.case.schema.tables import (
    BranchTable,
    BusTable,
    HeadTable,
    LineTable,
    NetworkTable,
    OutageTable,
    ProfilesTable,
    TimeTable,
)

__all__ = [
    "DEVICES",
    "BranchTable",
    "BusTable",
    "CloudTable",
    "CurveTable",
    "DeviceKind",
    "DeviceTable",
    "ESSTable",
    "ForecastTable",
    "GeneratorTable",
    "GeographyTable",
    "GridTable",
    "HeadTable",
    "LineTable",
    "LoadTable",
    "NetworkTable",
    "OutageTable",
    "PVTable",
    "ProfilesTable",
    "RepairTable",
    "StormTable",
    "Table",
    "TimeTable",
    "case_schema",
    "case_table",
    "defaults_table",
    "register_device",
    "unregister_device",
]
