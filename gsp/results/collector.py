"""The collector of cycles, which looks at what was made: a sixth of the time in which the package is imported."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# Whether something else in this process has put objects out of the collector's sight. They are counted one by one, 10
# ms for a million, so that once they were seen nobody asks again.
_others_freeze = False


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """No look for cycles while things are made that stay, such as modules and what a file says, and little else."""
    global _others_freeze
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            _others_freeze = _others_freeze or gc.get_freeze_count() > 0
            if not _others_freeze:
                # What was made joins the oldest objects, without a look at each.
                gc.freeze()
                gc.unfreeze()
            gc.enable()
