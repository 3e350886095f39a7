"""A mutation run: small faults put into the package one at a time, and whether a test notices."""
