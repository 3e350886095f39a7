"""The source paper's experiments as plain data, and what runs them."""
