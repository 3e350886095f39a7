"""Where the wires of a case come from: pandapower, files, or the case itself."""
