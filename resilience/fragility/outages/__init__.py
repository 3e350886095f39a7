"""Which line is down when: processes, repair, scenarios and their files."""
