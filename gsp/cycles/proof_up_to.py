"""What certificates of cycles and of passages have in common: they hold for every epsilon up to one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gsp.proofs.verdict import ProofVerdict, require_proved
from gsp.results.drawn import Drawn
from gsp.results.files import write_file


class ProofUpTo(Drawn):
    """A `verdict` with its `reason` in a sentence, and the proof as plain values where there is one."""

    verdict: ProofVerdict
    reason: str

    def _plain(self) -> dict[str, Any]:
        """What the checker reads, every number a hexadecimal double; raises `GspError` when it does not follow."""
        raise NotImplementedError

    def save(self, path: str | Path) -> None:
        """Write the proof as JSON, which `gsp verify` checks.

        Raises `GspError` unless the verdict is PROVED and the checker follows the proof, `OutputError` when the file
        cannot be written.
        """
        require_proved(self.verdict, self.reason, "Give a smaller epsilon, or parameters away from canards.")
        text = json.dumps(self._plain(), separators=(",", ":"), allow_nan=False)
        write_file((text + "\n").encode(), Path(path))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.verdict.name}, {self.reason})"
