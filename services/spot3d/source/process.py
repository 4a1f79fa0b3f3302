"""The source stage's process: plays a recording, or the built-in scene, to the others."""

import logging
import threading
import time

from spot3d.dataflow.node import Node
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.streams import new_stream
from spot3d.source.image_limit import refuse_large_images
from spot3d.source.player import END, OUT, PREVIEW, Player, Sent
from spot3d.source.sequence import FrameSequence, FrameStream
from spot3d.source.settings import SourceSettings
from spot3d_schemas import STAGES

log = logging.getLogger(__name__)

_PROGRESS = "fusion/progress"
FUSING_STAGES = tuple(stage for stage in STAGES if stage not in ("source", "segments"))
"""If one of these is missing, no frame is fused."""
EVERY_STAGE = tuple(stage for stage in STAGES if stage != "source")
START_LIMIT_S = 180.0
"""Longest wait for the stages before the first frame: a first start compiles kernels."""
_LOOK_S = 1.0
"""A longer wait for stages is logged."""


class MissingStagesError(RuntimeError):
    """Stages that a run needs are not alive."""


def run(
    link: LinkSettings,
    settings: SourceSettings,
    sequence: FrameSequence | FrameStream,
    rate_hz: float | None = None,
    stop: threading.Event | None = None,
    wait_for: tuple[str, ...] | None = None,
    stream: str | None = None,
    earlier: Sent | None = None,
) -> None:
    """Publish every frame of `sequence`, then its end. Returns when fusion has answered, or when stopped.

    rate_hz: frames per second; None: `settings.rate_hz`, and if that is 0 the recorded stamps (live) or as fast as
    fusion's progress allows (lossless). wait_for: stages that must be alive before the first frame; None: all of them
    in a lossless run, none in a live one. stream: a stream that this source continues; None: a new one.
    earlier: what was sent of it before. Raises MissingStagesError naming the stages that do not come, and SourceError
    for images that are too large.
    """
    if wait_for is None:
        wait_for = EVERY_STAGE if link.delivery == "lossless" else ()
    if not isinstance(sequence, FrameStream):
        refuse_large_images(sequence.intrinsics, settings.halved)
    with stop_on_signals(stop) as stopped, Node("source", link, stopped, (_PROGRESS,), (OUT, END, PREVIEW)) as node:
        _wait_for(node, wait_for)
        player = Player(node, stream or new_stream(), settings, earlier or Sent())
        player.play(sequence, rate_hz or settings.rate_hz or None)


def _wait_for(node: Node, stages: tuple[str, ...]) -> None:
    end_s, said = time.monotonic() + START_LIMIT_S, False
    while missing := node.alive.missing(stages, _LOOK_S, node.stop):
        if node.stop.is_set():
            return
        if time.monotonic() > end_s:
            raise MissingStagesError(
                f"{', '.join(missing)} of robot {node.link.robot!r} did not come on line within {START_LIMIT_S:.0f} "
                f"s; start {'it' if len(missing) == 1 else 'them'} on the router at {', '.join(node.link.connect)}"
            )
        if not said:
            log.info("waiting for %s (at most %.0f s)", ", ".join(missing), START_LIMIT_S)
            said = True
        # Taking messages keeps the heartbeat alive. They belong to an earlier stream.
        node.next(0.0)
