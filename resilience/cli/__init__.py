"""The command line: every command parses, calls the API, and prints."""

from resilience.cli.app import app, main

__all__ = ["app", "main"]
