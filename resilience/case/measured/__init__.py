"""Measured load and solar power of a country or zone, as files of ENTSO-E hold it."""
