"""Plans over scenarios: one first stage, what follows in each, its bound, and what it is worth."""
