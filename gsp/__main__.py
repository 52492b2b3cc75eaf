"""`python -m gsp` is the command line."""

from gsp.cli import main

if __name__ == "__main__":
    main()
