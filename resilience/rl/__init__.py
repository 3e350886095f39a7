"""Learned dispatchers: one strategy among the others, on the same case, simulator and storms."""
