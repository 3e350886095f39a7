"""Where policies are trained: episodes, what is observed of them, and what outputs mean."""
