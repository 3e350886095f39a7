"""Algorithms, one file each: `train(env, settings) -> Policy`."""
