"""The heatmap stage's process: joins frames with their boxes, and publishes their heat."""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from spot3d.dataflow.conversion import intrinsics_message, rgbd_frame
from spot3d.dataflow.join import Join, Outcome, images_waiting
from spot3d.dataflow.node import Node, Received
from spot3d.dataflow.previews import Previews
from spot3d.dataflow.serving import On, attempted, serve
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.dataflow.warm_up import warm_up
from spot3d.frame import RgbdFrame
from spot3d.heatmap.heat import Heatmap, weighted_heat
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.heatmap.thinning import thinned
from spot3d_schemas import Frame, Heat, Message, Proposals

_FRAME, _BOXES, _OUT, _PREVIEW = "source/frame", "proposals/boxes", "heatmap/heat", "heatmap/preview"
_FRAMES_WAITING = 16
"""Live: number of frames that wait for their boxes, so that proposals may take half a second; 24 MB at VGA."""
_BOXES_WAITING = 64

Pair = tuple[Received[Frame], Received[Proposals]]
M = TypeVar("M", bound=Message)


def run(link: LinkSettings, settings: HeatmapSettings, stop: threading.Event | None = None) -> None:
    """Publish the heat of every frame whose boxes arrive, until stopped by `stop`, SIGINT or SIGTERM.

    A frame that fails counts as an error; in a lossless run its heat is empty, so that no subscriber waits for it.
    """
    warm_up("heatmap", partial(_heat_first, settings))
    with stop_on_signals(stop) as stopped, Node("heatmap", link, stopped, (_FRAME, _BOXES), (_OUT, _PREVIEW)) as node:
        _serve(node, settings)


def _heat_first(settings: HeatmapSettings, frames: Sequence[RgbdFrame]) -> None:
    boxes = np.array([[60, 40, 40, 40, 1]], np.float32)
    weighted_heat(frames[0].depth_metres(), frames[0].intrinsics, boxes, settings)


def _serve(node: Node, settings: HeatmapSettings) -> None:
    previews = Previews(node, _PREVIEW)
    waiting = images_waiting(_FRAMES_WAITING, node.link), _BOXES_WAITING
    join = Join[Frame, Proposals](*waiting, "no frame", "no boxes")

    def take(add: Callable[[Received[M]], Outcome[Frame, Proposals]], given: Received[M]) -> None:
        waited = join.clear() if given.begins else []
        outcome = add(given)
        for frame in (*waited, *outcome.skipped):
            node.counters.drop(frame.reason)
        if outcome.pair is not None:
            _publish_heat(node, outcome.pair, settings, previews)

    serve(node, On(_FRAME, Frame, partial(take, join.add_left)), On(_BOXES, Proposals, partial(take, join.add_right)))


def _publish_heat(node: Node, pair: Pair, settings: HeatmapSettings, previews: Previews) -> None:
    message, boxes = pair[0].message, pair[1]
    frame = rgbd_frame(message)

    def made() -> Heatmap:
        return weighted_heat(frame.depth_metres(), frame.intrinsics, boxes.message.boxes, settings)

    heat = attempted(node, "heatmap", f"no heat for the frame at {frame.stamp_ns} ns", made)
    if heat is None:
        if node.link.delivery == "live":
            return
        heat = Heatmap(np.zeros(frame.depth.shape, np.uint8), 0, 0, len(boxes.message.boxes))
    for what, count in (("accepted", heat.accepted), ("masked", heat.masked), ("rejected", heat.rejected)):
        node.counters.event(what, count)
    sent, sent_heat = thinned(frame, heat.heat, node.link) if node.link.thin_link else (frame, heat.heat)
    # The boxes' trace is the longer one: it holds the source and the proposals.
    told = Heat(
        header=node.header(_OUT, boxes),
        intrinsics=intrinsics_message(sent.intrinsics),
        depth_scale=sent.depth_scale,
        colour=sent.colour,
        depth=sent.depth,
        depth_noise=message.depth_noise,
        heat=sent_heat,
        accepted=heat.accepted,
        masked=heat.masked,
        rejected=heat.rejected,
    )
    if node.publish(_OUT, told):
        node.measure_latency(told.header)
    previews.offer(told.header, heat.heat, frame.intrinsics)
