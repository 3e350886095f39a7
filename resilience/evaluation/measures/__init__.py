"""What is measured of trajectories, and what may be said of the differences."""
