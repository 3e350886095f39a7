"""`pytest tests/golden --regenerate` writes the files anew, for a change of physics that is meant.

Look at the difference before you commit it: it is the change of the model, row by row.
"""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--regenerate", action="store_true", help="write the golden LP files anew")


@pytest.fixture
def regenerate(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--regenerate", default=False))
