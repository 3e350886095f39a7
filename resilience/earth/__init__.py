"""Facts of the earth that cases and storms share: distances, averaging times, plausible winds."""
