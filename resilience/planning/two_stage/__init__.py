"""Two-stage programs: as one program, and cut by cut."""
