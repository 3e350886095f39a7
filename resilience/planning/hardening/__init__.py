"""What to build before the storm: which lines to strengthen, and what it saves."""
