"""The proposals stage's process: publishes the boxes of each frame."""

import threading
from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from spot3d.colour_alignment import AlignmentWatch
from spot3d.dataflow.conversion import rgbd_frame
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.serving import On, attempted, serve
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.warm_up import warm_up
from spot3d.frame import RgbdFrame
from spot3d.proposals.propose import propose
from spot3d.proposals.settings import ProposalSettings
from spot3d_schemas import Frame, Proposals

_IN, _OUT = "source/frame", "proposals/boxes"


def run(link: LinkSettings, settings: ProposalSettings, stop: threading.Event | None = None) -> None:
    """Publish the boxes of every frame that arrives, until stopped by `stop`, SIGINT or SIGTERM.

    A frame that fails counts as an error; in a lossless run it has no boxes, so that no subscriber waits for it.
    """
    warm_up("proposals", partial(_propose_first, settings))
    with stop_on_signals(stop) as stopped, Node("proposals", link, stopped, (_IN,), (_OUT,)) as node:
        serve(node, On(_IN, Frame, _Stage(node, settings).take))


def _propose_first(settings: ProposalSettings, frames: Sequence[RgbdFrame]) -> None:
    propose(frames[0].colour, frames[0].depth_metres(), frames[0].intrinsics, settings)


class _Stage:
    def __init__(self, node: Node, settings: ProposalSettings) -> None:
        self.node, self.settings, self.recording = node, settings, 0
        self.watch = AlignmentWatch()

    def take(self, given: Received[Frame]) -> None:
        frame = rgbd_frame(given.message)
        _answer(self.node, self.settings, given, frame)
        if given.begins or given.recording != self.recording:
            self.recording, self.watch, self.node.state = given.recording, AlignmentWatch(), ""
        # After the boxes are published, for which other stages wait.
        if told := self.watch.look(frame):
            self.node.state = told
            self.node.note(AlignmentWatch.EVENT, told)


def _answer(node: Node, settings: ProposalSettings, given: Received[Frame], frame: RgbdFrame) -> None:
    def found() -> NDArray[np.float32]:
        return propose(frame.colour.copy(), frame.depth_metres(), frame.intrinsics, settings)

    boxes = attempted(node, "proposals", f"no proposals for the frame at {frame.stamp_ns} ns", found)
    if boxes is None:
        if node.link.delivery == "live":
            return
        boxes = np.zeros((0, 5), np.float32)
    proposals = Proposals(header=node.header(_OUT, given), boxes=boxes)
    if node.publish(_OUT, proposals):
        node.measure_latency(proposals.header)
