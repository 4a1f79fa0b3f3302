"""Who is told how a run goes."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Watcher:
    """on_progress(fused, not fused, objects) is called often; on_event with one line for people."""

    on_progress: Callable[[int, int, int], None]
    on_event: Callable[[str], None]
