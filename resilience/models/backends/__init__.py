"""Solvers, each behind the same four calls; heavy libraries are imported when first used."""

from resilience.models.backends.base import Backend, Duals, Solution

__all__ = ["Backend", "Duals", "Solution"]
