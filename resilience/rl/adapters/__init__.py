"""The same training ground as others expect it: Gymnasium and PettingZoo."""
