"""When fusion's map is saved to a file, and when it is resumed from one."""

import logging
import time
from functools import partial
from pathlib import Path

from spot3d.dataflow.node import Node
from spot3d.dataflow.snapshot_file import SnapshotError, snapshot_bytes
from spot3d.dataflow.snapshot_writer import SnapshotWriter, snapshot_path
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.snapshot import Account, Kept, fusion_snapshot, keep, read_account, resume

log = logging.getLogger(__name__)

BEFORE = "before"
"""Suffix of the file with the map of the stream before: fusion-before.snapshot."""


class SnapshotKeeper:
    """The snapshots of one robot's map: one of its present stream, and one of the stream before."""

    def __init__(self, node: Node) -> None:
        interval_s = node.link.snapshot_interval_s
        self._path, self._on = snapshot_path(node.link, "fusion"), interval_s > 0
        self._node = node
        self._writer = SnapshotWriter(self._path, interval_s, lambda text: node.note("no snapshot", text))
        self._kept: Account | None = None

    def due(self, complete: bool) -> bool:
        """Whether the map is to be saved after this frame; complete: it is the stream's last."""
        return self._on and (complete or self._writer.due(time.monotonic()))

    def keep_last(self, fusion: Fusion, account: Account) -> None:
        """Save the map as the process ends, unless the last snapshot has all of it."""
        known = self._kept is not None and (self._kept.epoch, self._kept.fused_ns) == (account.epoch, account.fused_ns)
        if not self._on or known or account.fused_ns < 0:
            return
        kept = keep(fusion, account)
        try:
            fusion.objects()  # takes in the keyframes since the last update
        except Exception as error:
            self._node.crashed("objects", "cannot write the last snapshot", error)
        else:
            self.write(kept, last=True)

    def write(self, kept: Kept, last: bool = False) -> None:
        """Write a snapshot in a thread of its own; last: before this returns."""
        start_s = time.perf_counter()
        pieces = snapshot_bytes(fusion_snapshot(kept))
        log.debug("snapshot of %d bytes made in %.3f s", sum(map(len, pieces)), time.perf_counter() - start_s)
        self._writer.write(pieces, last, partial(self._written, kept.account))

    def _written(self, account: Account) -> None:
        self._kept = account
        self._node.counters.event("snapshots")

    def forget(self) -> None:
        """Void the last snapshot, and the one being written: nothing resumes from them."""
        if self._on:
            self._writer.forget()

    def close(self) -> None:
        """Wait for the snapshot being written."""
        self._writer.close()

    def begin(self, fusion: Fusion, stream: str) -> Account | None:
        """A stream begins: resume from its snapshot if there is one; set that of another stream aside."""
        if not (self._on and self._path.exists()):
            return None
        try:
            account, kept = read_account(self._path)
            if account.stream == stream:
                resume(fusion, kept, self._path)
                log.info("resumes from %s: %d frames of this stream", self._path, fusion.frame_count)
                return account
            self._path.replace(self._path.with_stem(f"{self._path.stem}-{BEFORE}"))
        except (SnapshotError, OSError) as error:
            self._node.note("no snapshot", f"the map begins empty: {error}")
        return None


def resumed(fusion: Fusion, path: Path) -> Account:
    """Resume from the map in a file that the user names. Raises SnapshotError, OSError."""
    account, kept = read_account(path)
    resume(fusion, kept, path)
    log.info(
        "resumes from %s: %d frames; poses must be in the same world (pose.provider given), which odometry's are not",
        path,
        fusion.frame_count,
    )
    return account
