"""Steps that are programs: voltages and ratings, commitment, ramps, curves, blocks, switches."""
