"""How Hypothesis behaves in every test here."""

from __future__ import annotations

from unittest import mock

from hypothesis import settings
from hypothesis.internal.conjecture import engine

SHRINK_S = 20
"""A failure is made smaller for so long at most: it has to be told before a test run is ended."""

settings.register_profile("resilience", deadline=None, print_blob=True)
settings.load_profile("resilience")
mock.patch.object(engine, "MAX_SHRINKING_SECONDS", SHRINK_S).start()
