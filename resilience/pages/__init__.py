"""Results as one self-contained HTML page each, to be sent to whoever has to act on them."""
