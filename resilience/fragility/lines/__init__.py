"""How strong lines are: curves, spans, and when they fail in a wind."""
