"""The declarative model of a microgrid, and its compilation for solvers."""
