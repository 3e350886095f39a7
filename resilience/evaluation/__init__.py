"""Dispatchers judged on the same storms, against the clairvoyant bound."""
