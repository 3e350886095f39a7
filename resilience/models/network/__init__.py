"""Wires as a graph: what can be merged, islands, power flow."""
