"""Two results held against each other: what changed in the case, and what that changed."""
