"""A case under construction."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from resilience.case.document import Document
from resilience.case.inline import Inline
from resilience.case.networks.network import Network
from resilience.case.networks.omissions import Omission
from resilience.case.schema import (
    BlackoutTable,
    GeographyTable,
    LineTable,
    PlanTable,
    StormTable,
    TankTable,
)
from resilience.case.window import Window


@dataclass
class Parts:
    """What has been read of a case; what could not be is `None`, or `None` inside a table.

    Attributes:
        document: the case file.
        window: the horizon.
        network: the network, once it is read.
        inline: what the file itself says of the network.
        lines: `[[line]]` tables with their titles in messages.
        tanks: `[[tank]]` tables likewise.
        places: (x, y) of buses by name.
        omissions: what of the network file is not modelled.
        geography: the table `[geography]`.
        storm: the table `[storm]`.
        blackout: the table `[blackout]`.
        plan: the table `[plan]`.
        sites: kind, table and title of what may be built at each place of `plan`.
        devices: by kind, tables with their titles in messages: `[[ess]] ess2`.
    """

    document: Document
    window: Window | None = None
    network: Network | None = None
    inline: Inline = field(default_factory=Inline)
    lines: list[tuple[LineTable, str]] = field(default_factory=list)
    tanks: list[tuple[TankTable, str]] = field(default_factory=list)
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    omissions: tuple[Omission, ...] = ()
    geography: GeographyTable | None = None
    storm: StormTable | None = None
    blackout: BlackoutTable | None = None
    plan: PlanTable | None = None
    sites: list[tuple[str, Any, str]] = field(default_factory=list)
    devices: dict[str, list[tuple[Any, str]]] = field(default_factory=dict)

    def all_devices(self) -> Iterator[tuple[str, Any, str]]:
        """`(kind, table, title)` of every device."""
        for kind, entries in self.devices.items():
            for table, title in entries:
                yield kind, table, title
