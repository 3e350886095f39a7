"""The present state, as an energy management system tells it: read, and checked like a case."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field

from resilience.arrays import Bools, Floats
from resilience.case.document import Document
from resilience.case.reading import read_table, show
from resilience.case.schema.fields import Name, NonNegative, Share, Table
from resilience.errors import CaseError, did_you_mean
from resilience.fragility.outages.bell import REFERENCE_MIN
from resilience.models.microgrid import Microgrid
from resilience.models.simulator.plant import LEVEL, STATE
from resilience.simulation.setting import Setting
from resilience.tolerances import SLOT_TOLERANCE

MAX_VALUES = 10_000
"""Of a forecast, and names in a list."""
SOURCE = Path("state")
"""How messages call a state that came from no file."""


def _moment(value: object) -> object:
    """A time from text; what is none is left to whoever checks its type."""
    if isinstance(value, str):
        try:
            return datetime.fromisoformat(value)
        except ValueError:
            return value
    return value


Moment = Annotated[datetime, BeforeValidator(_moment)]
Names = Annotated[tuple[Name, ...], Field(strict=False, max_length=MAX_VALUES)]
Values = Annotated[tuple[float, ...], Field(strict=False, max_length=MAX_VALUES)]


class StateTable(Table):
    """What is told of the present: what is not told is as it was, or as the case says."""

    has_any_size = True

    time: Moment = Field(description="local date and time, in the slot that is to be decided")
    soc: dict[Name, Share] = Field({}, description="state of charge of each storage, 0 to 1")
    energy_mwh: dict[Name, NonNegative] = Field(
        {}, description="energy in each storage, MWh, in place of its soc"
    )
    down: Names = Field(description="lines and units that are out now; [] for none")
    down_before: Names | None = Field(
        None, description="those out one slot ago; default: as told then"
    )
    tank_m3: dict[Name, NonNegative] = Field(
        {}, description="fuel in each tank, m³; default: what the last decision leaves"
    )
    forecast: dict[Name, Values] = Field(
        {},
        description="values of a profile of the case, the present slot first; default: the case's",
    )
    hazard_peak: str | None = Field(
        None, description="time of day at which today's hazard is forecast to peak, HH:MM"
    )
    devices: dict[Name, dict[Name, float]] = Field(
        {},
        description="what else devices carry, by name of the state, as generator.on; default: what "
        "the last decision leaves",
    )


@dataclass(frozen=True, eq=False)
class State:
    """A checked state of one microgrid.

    Attributes:
        t: slot of the case's horizon.
        energy: (units, 1) MWh stored, within what a storage may hold.
        line_up: (elements of the case, 1) what is in order.
        line_up_before: (elements of the case, 1) likewise one slot ago; None: as it was told then.
        fuel: m³ by tank, those that are told.
        forecast: by profile, its values from `t` on.
        centre: slot of 15 minutes at which today's hazard is forecast to peak; -1: unknown.
        devices: by name of the state and of the device, those that are told.
        notes: what was set right, in words.
        stated: the state as it was told, as JSON has it.
    """

    t: int
    energy: Floats
    line_up: Bools
    line_up_before: Bools | None
    fuel: Mapping[str, float]
    forecast: Mapping[str, Floats]
    centre: int
    devices: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]
    stated: Mapping[str, Any]


class Storage(NamedTuple):
    """What the units of a case may hold, (units,) each."""

    size_mwh: Floats
    low_mwh: Floats
    high_mwh: Floats


class StateReader:
    """Reads states of one setting.

    Args:
        setting: where decisions are made.
        fallible: names of the lines and units that may be out.

    Attributes:
        elements: lines and units of the case, in the order of `State.line_up`.
        carried: see `carried_labels`.
    """

    def __init__(self, setting: Setting, fallible: Iterable[str]) -> None:
        self.case, self.fallible = setting.case, tuple(dict.fromkeys(fallible))
        self.carried = carried_labels(setting)
        self.elements = setting.case.elements
        self._place = {name: setting.case.element(name) for name in self.fallible}

    @cached_property
    def storage(self) -> Storage:
        """Of the case's storage, in its order."""
        units = self.case.ess
        size = np.array([u.e_mwh for u in units])
        low, high = (np.array([getattr(u, k) for u in units]) for k in ("soc_min", "soc_max"))
        return Storage(size, low * size, high * size)

    def read(self, raw: object, source: Path | None = None) -> State:
        """A state from plain data, as JSON has it.

        Args:
            raw: what was told.
            source: the file that it is from, for messages.

        Raises:
            CaseError: every mistake in it.
        """
        document = Document(source or SOURCE)
        if not isinstance(raw, dict):
            hint = '{"time": "2016-07-12T14:00", "soc": {"ess1": 0.5}, "down": []}, say'
            document.add((), "", "", show(raw), "a JSON object", hint)
            raise CaseError(document.mistakes, "the state")
        table, _ = read_table(StateTable, raw, document, "", ())
        # An unsound table holds what was told as it was told.
        t = self._slot(_moment(table.time), document)
        energy, notes = self._energy(table, document)
        self._check_names(table, document)
        centre = self._centre(table.hazard_peak, document)
        if document.mistakes:
            raise CaseError(document.mistakes, "the state")
        before = None if table.down_before is None else self._up(table.down_before)
        return State(
            t=t,
            energy=energy,
            line_up=self._up(table.down),
            line_up_before=before,
            fuel=table.tank_m3,
            forecast={k: np.array(v, float) for k, v in table.forecast.items()},
            centre=centre,
            devices=table.devices,
            notes=tuple(notes),
            stated=table.model_dump(mode="json", exclude_unset=True),
        )

    def _slot(self, time: object, document: Document) -> int:
        """The slot in which a moment is; -1 where there is none."""
        window = self.case.window
        if not isinstance(time, datetime):
            return -1
        if time.tzinfo is not None:
            hint = "the case is in local time; drop the offset"
            document.add(("time",), "", "time", time.isoformat(), "a time without offset", hint)
            return -1
        minutes = (time - window.start).total_seconds() / 60.0
        t = int(np.floor(minutes / window.step_min + SLOT_TOLERANCE))
        if not 0 <= t < window.slots:
            allowed, hint = f"a time of the case's horizon, {window}", "is the case today's?"
            document.add(("time",), "", "time", time.isoformat(), allowed, hint)
        return t

    def _energy(self, table: StateTable, document: Document) -> tuple[Floats, list[str]]:
        """(units, 1) MWh stored, and what was set right; mistakes are noted."""
        names, storage = [unit.name for unit in self.case.ess], self.storage
        soc, energy = table.soc or {}, table.energy_mwh or {}
        for key, values in (("soc", soc), ("energy_mwh", energy)):
            self._check_keys((key,), values, names, "a storage of the case", document)
        stored, notes = np.zeros((len(names), 1)), []
        unsound = table.soc is None or table.energy_mwh is None
        for k, name in enumerate(names):
            if (name in soc) == (name in energy):
                if name in soc or not unsound:
                    value = "both soc and energy_mwh" if name in soc else "nothing"
                    hint = f'"soc": {{"{name}": 0.5}}, or energy_mwh in its place'
                    document.add(("soc",), "", f"soc.{name}", value, "one of the two", hint)
                continue
            size = float(storage.size_mwh[k])
            mwh = soc[name] * size if name in soc else energy[name]
            if mwh > size:
                allowed, hint = f"0 to {size:g}, its e_mwh", "is the unit right?"
                key = f"energy_mwh.{name}"
                document.add(("energy_mwh",), "", key, show(mwh), allowed, hint)
            stored[k] = np.clip(mwh, storage.low_mwh[k], storage.high_mwh[k])
            if stored[k, 0] != mwh:
                notes.append(
                    f"{name} holds {mwh:.6g} MWh, beyond soc_min or soc_max: decided as if it "
                    f"held {stored[k, 0]:.6g}"
                )
        return stored, notes

    def _check_names(self, table: StateTable, document: Document) -> None:
        """Notes names that the case does not have."""
        kind = "a line or unit of the case that may be out"
        for key in ("down", "down_before"):
            for name in getattr(table, key) or ():
                if name not in self.fallible:
                    hint = did_you_mean(name, self.fallible)
                    if name in self.case.network.line_names:
                        hint = f"mark line {name} with breakpoint = true; {hint}"
                    document.add((key,), "", key, show(name), kind, hint)
        tanks = [tank.name for tank in self.case.tank]
        self._check_keys(("tank_m3",), table.tank_m3, tanks, "a tank of the case", document)
        for tank in self.case.tank:
            level = (table.tank_m3 or {}).get(tank.name, 0.0)
            if level > tank.capacity_m3:
                allowed = f"0 to {tank.capacity_m3:g}, its capacity_m3"
                key, hint = f"tank_m3.{tank.name}", "is the unit right?"
                document.add(("tank_m3",), "", key, show(level), allowed, hint)
        profiles = sorted(self.case.profiles)
        kind = "a profile of the case"
        self._check_keys(("forecast",), table.forecast, profiles, kind, document)
        kind = "a state that devices of the case carry"
        self._check_keys(("devices",), table.devices, list(self.carried), kind, document)
        for name, values in (table.devices or {}).items():
            if name in self.carried:
                where = ("devices", name)
                kind = f"a device that carries {name}"
                self._check_keys(where, values, self.carried[name], kind, document)

    @staticmethod
    def _check_keys(
        where: tuple[str, ...],
        values: Mapping[str, Any] | None,
        names: Iterable[str],
        allowed: str,
        document: Document,
    ) -> None:
        names = tuple(names)
        for name in values or ():
            if name not in names:
                key = ".".join((*where, name))
                document.add(where, "", key, "an unknown name", allowed, did_you_mean(name, names))

    @staticmethod
    def _centre(text: str | None, document: Document) -> int:
        """Slot of 15 minutes of a time of day; -1: unknown."""
        if text is None:
            return -1
        match = re.fullmatch(r"([01]\d|2[0-3]):([0-5]\d)", text, re.ASCII)
        if match is None:
            hint = "14:30, say; leave it out where nobody knows"
            document.add(("hazard_peak",), "", "hazard_peak", show(text), "HH:MM", hint)
            return -1
        return int((int(match[1]) * 60 + int(match[2])) // REFERENCE_MIN)

    def _up(self, down: Iterable[str]) -> Bools:
        """(elements of the case, 1) what is in order."""
        up = np.ones((len(self.elements), 1), bool)
        up[[self._place[name] for name in down]] = False
        return up


def carried_labels(setting: Setting) -> dict[str, tuple[str, ...]]:
    """What devices carry beside energy and fuel: name of the state to names of the devices."""
    stage = setting.simulator.form.stage
    states = setting.start_states()
    return {
        after.name: tuple(after.labels)
        for _, after in stage.states
        if after.name in states and after.name not in (STATE, LEVEL)
    }


def fallible_names(microgrid: Microgrid, lines: Iterable[str]) -> tuple[str, ...]:
    """Lines and units that may be out: those of the process, of the case's outages, and units."""
    case = microgrid.case
    return (*lines, *(outage.line for outage in case.outages), *case.fallible_units)
