"""Messages that somebody can read."""

from __future__ import annotations

import pickle

from resilience.errors import MAX_MESSAGE, UsageError


def test_what_is_too_long_to_read_loses_its_middle() -> None:
    error = UsageError(f"method {'x' * 200_000}; allowed: lp", hint="lp is the fastest")
    assert len(error.message) == MAX_MESSAGE + 5
    assert error.message.startswith("method xxx")
    assert str(error).endswith("xxx; allowed: lp\nhint: lp is the fastest")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error)
    words = "a" * MAX_MESSAGE
    assert UsageError(words).message == words
