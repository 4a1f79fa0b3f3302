"""3D boxes of a single frame after all stages, as of a camera that has just begun, stands still, or moves."""

from dataclasses import replace

import numpy as np

from spot3d.boxes import moved
from spot3d.evaluate.degraded import Degradation
from spot3d.evaluate.frame_tables import BOTH_METHODS, FoundInFrames
from spot3d.evaluate.labelled import DataSet, LabelledFrame
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
            alone = FrameList([replace(item.frame, T_world_camera=np.eye(4))])  # the camera's frame is the world
            _add(item, alone, given, ours, peer)
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
    given, kiss = (settings.changed("pose", provider=provider) for provider in ("given", "kiss"))
    shakes = [(f"{1e3 * m:g} mm {d:g} deg", given, Degradation(metres=m, degrees=d)) for m, d in SHAKES]
    ways = [("true", given, Degradation()), *shakes, ("KISS-ICP", kiss, Degradation())]
    for dataset in datasets:
        found = {name: (FoundInFrames(), FoundInFrames()) for name, *_ in ways}
        for item in dataset.frames:
            views = FrameList(moved_views(item.frame))
            for name, how, worse in ways:
                _add(item, worse.of(views), how, *found[name])
        for name, (ours, peer) in found.items():
            table.add(dataset.name, name, *ours.cells(), *peer.cells(), peer.true)
            table.notes += ours.behind(peer, f"{dataset.name}, poses {name}")
    table.notes.append("Boxes are shifted by the mean error of the run's poses.")
    return table


def _add(
    item: LabelledFrame, sequence: FrameSequence, settings: Settings, ours: FoundInFrames, peer: FoundInFrames
) -> None:
    """Add the boxes that a run of the sequence finds, and the peer's by the run's poses, as seen in the frame.

    The frame's camera is the world of the true poses.
    """
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
    for method, found in zip((ours, peer), boxes, strict=True):
        surfaces = [box_surface(moved(box, T)) for box in found]
        method.add(item, boxes_in_view(surfaces, np.eye(4), item.frame.intrinsics))
