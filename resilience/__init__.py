"""Resilient dispatch of microgrids in storms: one model, proven bounds, every dispatcher judged alike."""
