"""3D boxes of a single frame after all stages, as of a camera that has just begun, stands still, or moves."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.boxes import Box3D, moved
from spot3d.camera import Intrinsics
from spot3d.evaluate.degraded import Degradation
from spot3d.evaluate.frame_tables import BOTH_METHODS, FoundInFrames
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.measured_run import as_the_run_has_it, tracked_poses, world_alignment
from spot3d.evaluate.moved_views import moved_views
from spot3d.evaluate.peer import PEER
from spot3d.evaluate.peer_map import PeerMap
from spot3d.evaluate.projection import box_surface, boxes_in_view
from spot3d.evaluate.robustness import SHAKES
from spot3d.evaluate.scores import recall_of
from spot3d.evaluate.table import Table, columns
from spot3d.pipeline import PipelineStep, run_pipeline
from spot3d.settings import Settings
from spot3d.source.sequence import FrameList, FrameSequence


def still_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Success (SR) and detection rate (DR) at IoU 0.5 of the objects' 3D boxes, projected into their frame.

    Unlike the finder's pixels (`proposals_table`), these boxes passed the votes, here of one view, and every rule for
    objects. The peer's clusters are boxed in 3D too. Raises StageFailedError if a stage fails on a frame.
    """
    title = "Single frame through all stages: 3D boxes drawn into it"
    table = Table("still", title, (*columns("data"), *BOTH_METHODS))
    given = settings.changed("pose", provider="given")
    for dataset in datasets:
        ours, peer = FoundInFrames(), FoundInFrames()
        for item in dataset.frames:
            frame = item.frame
            alone = FrameList([replace(frame, T_world_camera=np.eye(4))])  # the camera's frame is the world
            result = run_pipeline(alone, given)
            result.failures.refuse()
            ours.add(item, _drawn([one.box for one in result.objects.objects], frame.intrinsics))
            cloud = PeerMap(1)
            cloud.add(frame.depth_metres(), frame.intrinsics, np.eye(4))
            peer.add(item, _drawn(cloud.found(settings.fusion).boxes, frame.intrinsics))
        table.add(dataset.name, *ours.cells(), *peer.cells(), peer.true)
        table.curves += [recall_of(dataset.name, "ours", ours.iou), recall_of(dataset.name, PEER, peer.iou)]
        table.notes += ours.behind(peer, dataset.name)
    table.notes.append(
        "A true box encloses an object's pixels, with or without depth; a found one encloses its 3D box, whose "
        "corners may lie outside the object's outline."
    )
    return table


def moving_table(datasets: list[DataSet], settings: Settings) -> Table:
    """Like `still_table`, for views of a camera that moves around what a frame shows (see `moved_views`).

    Poses are given, true or shaken, or found by the system. Boxes are projected into the first view. The peer has the
    run's poses. Raises StageFailedError if a stage fails on a frame.
    """
    title = "Single frame as a moving camera sees it: 3D boxes drawn into it"
    table = Table("moving", title, (*columns("data", "poses"), *BOTH_METHODS))
    ways = [
        ("true", settings.changed("pose", provider="given"), Degradation()),
        *(
            (f"{1e3 * m:g} mm {d:g} deg", settings.changed("pose", provider="given"), Degradation(metres=m, degrees=d))
            for m, d in SHAKES
        ),
        ("KISS-ICP", settings.changed("pose", provider="kiss"), Degradation()),
    ]
    for dataset in datasets:
        found = {name: (FoundInFrames(), FoundInFrames()) for name, *_ in ways}
        for item in dataset.frames:
            views = FrameList(moved_views(item.frame))
            for name, how, worse in ways:
                ours, peer = found[name]
                boxes = _found_in_run(worse.of(views), how)
                for one, of_method in zip((ours, peer), boxes, strict=True):
                    one.add(item, _drawn(of_method, item.frame.intrinsics))
        for name, (ours, peer) in found.items():
            table.add(dataset.name, name, *ours.cells(), *peer.cells(), peer.true)
            table.notes += ours.behind(peer, f"{dataset.name}, poses {name}")
    table.notes.append("Boxes are shifted by the mean error of the run's poses.")
    return table


def _found_in_run(sequence: FrameSequence, settings: Settings) -> tuple[list[Box3D], list[Box3D]]:
    """The boxes that a run finds, and the peer's by the run's poses, in the world of the true poses."""
    cloud, T_world_map = PeerMap(len(sequence)), np.eye(4)

    def follow(step: PipelineStep) -> None:
        nonlocal T_world_map
        if not step.refused:
            cloud.add(*as_the_run_has_it(step))
            T_world_map = np.eye(4) if step.pose.T_world_map is None else step.pose.T_world_map

    result = run_pipeline(sequence, settings, follow)
    result.failures.refuse()
    T = world_alignment(sequence, tracked_poses(result))
    boxes = [one.box for one in result.objects.objects], cloud.found(settings.fusion).moved(T_world_map).boxes
    ours, peer = ([moved(box, T) for box in some] for some in boxes)
    return ours, peer


def _drawn(boxes: list[Box3D] | tuple[Box3D, ...], camera: Intrinsics) -> NDArray[np.float64]:
    """(n, 4) [x, y, w, h] pixels around the image of boxes that are in the camera's frame."""
    return boxes_in_view([box_surface(box) for box in boxes], np.eye(4), camera)
