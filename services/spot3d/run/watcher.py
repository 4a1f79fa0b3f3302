"""Who is told how a run goes."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Watcher:
    """on_progress(fused, not fused, objects) is called often; the others with one line for people.

    on_event: something has happened to the run; on_note: it is as it should be.
    """

    on_progress: Callable[[int, int, int], None]
    on_event: Callable[[str], None]
    on_note: Callable[[str], None]
