"""Stochastic dual dynamic programming: the future cost of every slot and mode, as cuts."""
