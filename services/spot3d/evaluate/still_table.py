"""A single frame through every stage, as of a camera that has just begun, or stands still: its boxes in 3D."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics
from spot3d.evaluate.frame_tables import BOTH_METHODS, FoundInFrames
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.peer import PEER
from spot3d.evaluate.peer_map import PeerMap
from spot3d.evaluate.projection import box_surface, boxes_in_view
from spot3d.evaluate.scores import recall_of
from spot3d.evaluate.table import Column, Table
from spot3d.pipeline import run_pipeline
from spot3d.settings import Settings
from spot3d.source.sequence import FrameList


def still_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Success (SR) and detection rate (DR) at IoU 0.5 of the objects' 3D boxes, drawn into the frame that they are of.

    Unlike the finder's pixels (`proposals_table`), these boxes went through the votes, of one view here, and every
    rule for objects; the peer's clusters are boxed in 3D too.
    """
    title = "Single frame through all stages: 3D boxes drawn into it"
    table = Table("still", title, (Column("data"), *BOTH_METHODS))
    given = settings.changed("pose", provider="given")
    for dataset in datasets:
        ours, peer = FoundInFrames(), FoundInFrames()
        for item in dataset.frames:
            frame = item.frame
            alone = FrameList([replace(frame, T_world_camera=np.eye(4))])  # its camera is the world
            found = run_pipeline(alone, given).objects.objects
            ours.add(item, _drawn([one.box for one in found], frame.intrinsics))
            cloud = PeerMap(1)
            cloud.add(frame.depth_metres(), frame.intrinsics, np.eye(4), settings.fusion.range_max)
            peer.add(item, _drawn(cloud.found(settings.fusion).boxes, frame.intrinsics))
        table.add(dataset.name, *ours.cells(), *peer.cells(), peer.true)
        table.curves += [recall_of(dataset.name, "ours", ours.iou), recall_of(dataset.name, PEER, peer.iou)]
        table.notes += ours.behind(peer, dataset.name)
    table.notes.append(
        "A true box is around an object's pixels, with depth or without; a found one is around its 3D box, of which a "
        "corner may reach beyond the object's outline."
    )
    return table


def _drawn(boxes: list[Box3D] | tuple[Box3D, ...], camera: Intrinsics) -> NDArray[np.float64]:
    """(n, 4) [x, y, w, h] pixels around the boxes, of the camera's frame, in its image."""
    return boxes_in_view([box_surface(box) for box in boxes], np.eye(4), camera)
