"""Deterministic methods: how a plan is found, what it relaxes, and what bound it proves."""

from __future__ import annotations

from collections.abc import Callable

from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import MethodOptions, MethodResult
from resilience.models.methods.conic import nlp, socp
from resilience.models.methods.exact import exact
from resilience.models.methods.linear import lp, milp
from resilience.models.methods.meshed import with_cliques
from resilience.models.methods.minlp import minlp
from resilience.models.methods.units import in_own_units
from resilience.models.microgrid import Physics

Method = Callable[[CaseProgram, MethodOptions], MethodResult]

METHODS: dict[str, tuple[Method, Physics]] = {
    "lp": (in_own_units(lp), "lindistflow"),
    "milp": (in_own_units(milp), "lindistflow"),
    "socp": (in_own_units(with_cliques(socp)), "distflow"),
    "nlp": (in_own_units(with_cliques(nlp)), "distflow"),
    "minlp": (in_own_units(with_cliques(minlp)), "distflow"),
    "exact": (in_own_units(exact), "distflow"),
}
"""Each method with its default physics."""

__all__ = ["METHODS", "Method", "MethodOptions", "MethodResult"]
