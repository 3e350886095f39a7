"""All kinds of files, by name."""

from __future__ import annotations

from importlib.util import find_spec

from tests.fuzz.cases import CASES
from tests.fuzz.kinds import Kind
from tests.fuzz.results import RESULTS
from tests.fuzz.weather import WEATHER

KINDS: dict[str, Kind] = {**CASES, **WEATHER, **RESULTS}
if find_spec("torch") and find_spec("safetensors"):
    from tests.fuzz.learned import LEARNED

    KINDS |= LEARNED
