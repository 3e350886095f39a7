"""What an operator may believe of the rest of a storm, given what failed so far."""
