"""A first case file for a network: its own loads and sources, and examples to fill in."""

from resilience.case.starter.text import Starter, new_case_text, starter

__all__ = ["Starter", "new_case_text", "starter"]
