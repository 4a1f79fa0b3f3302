"""Updates of the objects, computed beside the fusing of further frames."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import SimpleQueue

import numpy as np

from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.process_use import let_frames_go_first
from spot3d.dataflow.stopping import end_threads
from spot3d.found_object import FoundObject, FoundObjects
from spot3d.fusion.fusion import ObjectsTask
from spot3d.fusion.snapshot import Kept
from spot3d.fusion.snapshot_keeper import SnapshotKeeper
from spot3d_schemas import Message, Object3D, Objects

_OUT = "fusion/objects"
_WORD_S = 1.0
"""A stage that waits for an update reports progress this often: the first one may have to compile its kernels."""


@dataclass(frozen=True, slots=True)
class Update:
    """One update to be computed: of the map after `frame_count` frames, once `given` was handled.

    epoch: of the map. kept: what is to be saved afterwards.
    """

    task: ObjectsTask
    frame_count: int
    given: Received[Message]
    map_points: int
    map_limit_reached: bool
    complete: bool
    epoch: str
    kept: Kept | None = None


class Updates:
    """One thread that computes and publishes one update at a time, in their order."""

    def __init__(self, node: Node, keeper: SnapshotKeeper) -> None:
        self._node, self._keeper = node, keeper
        self._submitted = SimpleQueue[Update | None]()
        self._idle = threading.Event()
        self._idle.set()
        self._wanted: Update | None = None
        self._publishing = threading.Lock()
        self._thread = threading.Thread(target=self._work, name="objects", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread, after the update that it may be computing."""
        self._wanted = None
        self._submitted.put(None)
        end_threads((self._thread,))

    @property
    def ended(self) -> bool:
        """Whether the thread has ended."""
        return not self._thread.is_alive()

    @property
    def busy(self) -> bool:
        """Whether an update is being computed."""
        return not self._idle.is_set()

    def wait(self, meanwhile: Callable[[], None], interval_s: float = _WORD_S) -> bool:
        """Wait until no update is being computed; returns False if the stage is to stop.

        meanwhile: called repeatedly, so that those who wait for this stage hear that it is alive.
        """
        said_s = time.monotonic()
        while self.busy and not self._node.stop.is_set():
            self._node.turn()
            self._idle.wait(0.1)
            if time.monotonic() - said_s >= interval_s:
                meanwhile()
                said_s = time.monotonic()
        return not self.busy

    def submit(self, update: Update) -> None:
        """Compute and publish an update; only while not busy."""
        self._wanted = update
        self._idle.clear()
        self._submitted.put(update)

    def forget(self) -> None:
        """Void the update being computed, as its map is gone: it is not published once this returns."""
        with self._publishing:
            self._wanted = None

    def _work(self) -> None:
        let_frames_go_first()
        while (update := self._submitted.get()) is not None:
            try:
                self._compute(update)
            except Exception as error:
                self._node.crashed("objects", f"no objects after {update.frame_count} frames", error)
            self._idle.set()

    def _compute(self, update: Update) -> None:
        message = _message(self._node, update, update.task())
        with self._publishing:
            if self._wanted is update:
                self._node.publish(_OUT, message)
                if update.kept is not None:
                    self._keeper.write(update.kept)


def _message(node: Node, update: Update, found: FoundObjects) -> Objects:
    return Objects(
        header=node.header(_OUT, update.given),
        objects=tuple(object_message(item) for item in found.objects),
        up=np.asarray(found.up, np.float64),
        frame_count=found.frame_count,
        map_points=update.map_points,
        map_limit_reached=update.map_limit_reached,
        complete=update.complete,
        left_out=dict(found.left_out),
        keyframes_dropped=found.keyframes_dropped,
        epoch=update.epoch,
    )


def object_message(found: FoundObject) -> Object3D:
    """A found object as messages state it; the colour is rounded to bytes."""
    red, green, blue = (int(value) for value in np.clip(np.rint(found.colour), 0, 255))
    return Object3D(
        id=found.id,
        confidence=float(found.confidence),
        views=int(found.views),
        centre=found.box.centre,
        size=found.box.size,
        rotation=found.box.rotation,
        points=int(found.points),
        colour=(red, green, blue),
    )
