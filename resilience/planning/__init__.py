"""Plans over known outages and over scenarios, with certificate and files."""
