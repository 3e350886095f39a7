"""The world that dispatchers meet, stepped slot by slot."""
