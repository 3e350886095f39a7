"""The networks that act, and how they are run without torch."""
