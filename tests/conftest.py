"""How Hypothesis behaves in every test here.

A failure is told as it was found, not made smaller first: that took minutes, in which a test run
may be ended before it says anything. `pytest --hypothesis-profile shrink TEST` makes it smaller.
"""

from __future__ import annotations

from hypothesis import Phase, settings

settings.register_profile("shrink", deadline=None)
settings.register_profile(
    "told at once",
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    print_blob=True,
)
settings.load_profile("told at once")
