"""Device physics, and the only place for it: one file per component, equations at its top."""

from resilience.models.components.base import Component, Injection
from resilience.models.components.bus import Buses
from resilience.models.components.cold_load import ColdLoads
from resilience.models.components.ess import ESS
from resilience.models.components.fleet import (
    DeviceFleet,
    EnergyTerm,
    Role,
    bus_capacity,
    device_fleets,
    fleet_class,
    fleet_classes,
    in_roles,
)
from resilience.models.components.forming import Energised, forming_now
from resilience.models.components.generator import Generators
from resilience.models.components.grid import Grids
from resilience.models.components.line import Lines
from resilience.models.components.load import Loads
from resilience.models.components.pv import PV
from resilience.models.components.sited import Sited
from resilience.models.components.strengthened import Strengthened
from resilience.models.components.tank import Tanks
from resilience.models.components.topology import Topology

__all__ = [
    "ESS",
    "PV",
    "Buses",
    "ColdLoads",
    "Component",
    "DeviceFleet",
    "Energised",
    "EnergyTerm",
    "Generators",
    "Grids",
    "Injection",
    "Lines",
    "Loads",
    "Role",
    "Sited",
    "Strengthened",
    "Tanks",
    "Topology",
    "bus_capacity",
    "device_fleets",
    "fleet_class",
    "fleet_classes",
    "forming_now",
    "in_roles",
]
