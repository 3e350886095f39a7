"""`python -m resilience`: the command line."""

from resilience.cli import main

main()
