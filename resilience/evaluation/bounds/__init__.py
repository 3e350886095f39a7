"""What nobody without foreknowledge stays below on average."""
