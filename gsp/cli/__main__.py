"""`python -m gsp.cli`."""

from gsp.cli import main

main()
