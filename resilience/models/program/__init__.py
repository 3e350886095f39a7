"""A stage unrolled into numbers, and what judges answers to it."""
