"""objects.jsonl: how the objects of a run came to be, one line an update."""

import json
from pathlib import Path

from spot3d.run.bounded_file import BoundedFile
from spot3d.run.results import RunResult, objects_document

NAME = "objects.jsonl"
LIMIT_BYTES = 256 * 2**20
"""Longest file: hours of a table with a dozen objects."""


class Timeline(BoundedFile):
    """The file of the updates."""

    def __init__(self, path: Path, limit_bytes: int = LIMIT_BYTES) -> None:
        super().__init__(path, limit_bytes, "updates")

    def add_update(self, stamp_ns: int, found: RunResult, complete: bool) -> None:
        """One update: the objects after the frame of this stamp. complete: those of all frames."""
        self.add(json.dumps({"stamp_ns": stamp_ns, "complete": complete, **objects_document(found)}))
