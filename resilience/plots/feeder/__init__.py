"""The feeder as a map: where its buses are drawn, what happens there slot by slot, a picture."""
