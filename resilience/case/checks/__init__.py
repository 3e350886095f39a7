"""Rules that join keys and tables of a case, each with a hint."""
