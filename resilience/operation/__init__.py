"""A policy in operation: one decision per slot, from the present state and what is remembered."""
