"""What a plan says: what to do, why load is shed, where fuel went."""
