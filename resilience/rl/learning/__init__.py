"""What learners share: replay, returns, starts, updates from a memory."""
