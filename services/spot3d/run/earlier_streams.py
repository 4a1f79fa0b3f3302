"""Results of a run's streams before the last: a camera that begins anew is in another world frame."""

import shutil
from collections import Counter, deque
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from spot3d.run.growing_files import TRAJECTORY, GrowingFiles
from spot3d.run.lost_tracking import LostTracking, Stretch
from spot3d.run.results import RESULTS, RunResult, objects_document, write_json
from spot3d_schemas import Progress

FOLDER = "streams"
"""Folder of the earlier streams in a run's folder; each has a subfolder, `1` and so on."""
MOST = 20
"""Number of earlier streams whose results are kept, as by `spot3d results`; of others only the counts are."""


def forget_streams(run: Path) -> None:
    """Delete the folders of streams that an earlier run into this folder has left, and nothing else of that name."""
    for place in (run / FOLDER).glob("[0-9]*"):
        if place.name.isdecimal() and (place / TRAJECTORY).is_file():
            shutil.rmtree(place, ignore_errors=True)


class EarlierStreams:
    """Keeps the results of streams that are over, in folders beside the current stream's, and their counts.

    files: the current stream's, in the run's folder. fused, skipped, lost_poses: frames of all earlier streams.
    documents, lost: of those whose results are kept, for the report.
    """

    def __init__(self, files: GrowingFiles) -> None:
        self._files, self._run = files, files.folder
        self.fused = self.lost_poses = self._count = 0
        self.skipped: Counter[str] = Counter()
        self._lost: deque[list[Stretch]] = deque(maxlen=MOST)
        self._documents: deque[dict[str, Any]] = deque(maxlen=MOST)

    @property
    def lost(self) -> list[Stretch]:
        """Where tracking was lost, stream by stream."""
        return [stretch for stretches in self._lost for stretch in stretches]

    @property
    def documents(self) -> list[dict[str, Any]]:
        """The report's entry of each stream."""
        return list(self._documents)

    def leave(self, found: RunResult, progress: Progress | None, lost: LostTracking) -> list[str]:
        """Keep the results of the current stream, which is over, with its map as last saved; returns what to report."""
        self._count += 1
        place = self._run / FOLDER / str(self._count)
        told = self._files.notices()
        told.append(f"the camera begins another stream; earlier results are in {place.relative_to(self._run)}")
        try:
            place.mkdir(parents=True, exist_ok=True)
            self._files.leave(place)
            for name in RESULTS:
                if (kept := self._run / name).is_file():
                    kept.replace(place / name)
            write_json(place / "objects.json", objects_document(found))
        except OSError as error:
            told.append(f"these results are incomplete: {error}")
        if self._count > MOST:
            oldest = self._run / FOLDER / str(self._count - MOST)
            shutil.rmtree(oldest, ignore_errors=True)
            told.append(f"{oldest.relative_to(self._run)} is deleted, since at most {MOST} streams are kept")
        self._add(place, found, progress, lost)
        return told

    def _add(self, place: Path, found: RunResult, progress: Progress | None, lost: LostTracking) -> None:
        fused, skipped = (0, {}) if progress is None else (progress.fused, dict(progress.skipped))
        # `to_the_end` means the end of that stream, not of the run.
        stretches = [replace(stretch, to_the_end=False) for stretch in lost.stretches()]
        self.fused, self.lost_poses = self.fused + fused, self.lost_poses + lost.frames
        self.skipped.update(skipped)
        self._lost.append(stretches)
        self._documents.append(
            {
                "folder": str(place.relative_to(self._run)),
                "fused": fused,
                "skipped": skipped,
                "lost_poses": lost.frames,
                "lost": [asdict(stretch) for stretch in stretches],
                "objects": len(found.objects),
            }
        )
