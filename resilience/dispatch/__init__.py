"""Dispatchers, and the deterministic plan that they are measured against."""
