"""The command line: `gsp models`, `gsp split`, `gsp expand`, `gsp check`, `gsp verify`, `gsp choose`, `gsp report`,
`gsp run`, `gsp compare`, `gsp demo`, `gsp export`.

Exit status 0 when all is well, 1 when `check` finds that normal hyperbolicity does not hold or `verify` that a
proof does not, 2 on bad input or when the output cannot be written, 3 when `check --prove` leaves it undecided, 70 on
a defect of gsp, 130 when interrupted. Heavy modules are imported by the command that needs them, so that help is
quick.
"""

from __future__ import annotations

from gsp.cli import checking, comparing, declaring, deriving, running, writing
from gsp.cli.program import cli, main

__all__ = ["checking", "cli", "comparing", "declaring", "deriving", "main", "running", "writing"]
