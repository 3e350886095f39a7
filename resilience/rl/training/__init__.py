"""A training from its options to its folder, and its curves."""
