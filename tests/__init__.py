"""Facts about the package; helper modules are imported by their whole name, `tests.stepping`."""
