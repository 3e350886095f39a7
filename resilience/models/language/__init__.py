"""The language of one step: a stage, and the tree of nodes it is unrolled over."""
