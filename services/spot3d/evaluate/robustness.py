"""How results degrade with poses, depth, colour, frame rate and image size, which tuned scenes do not show."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from spot3d.drawing.charts import Curve
from spot3d.evaluate.degraded import SEED, Degradation
from spot3d.evaluate.frame_tables import BOTH_METHODS, FoundInFrames, boxes_in_frame, proposals_and_heat
from spot3d.evaluate.labelled import DataSet
from spot3d.evaluate.measured_run import MeasuredRun, measure
from spot3d.evaluate.object_tables import (
    NOTE_CARRIED,
    NOTE_NO_OBJECT,
    NOTE_PEER,
    NOTE_POSES,
    OURS,
    POSES,
    by_method,
    overlap_measures,
    point_cells,
    point_measures,
    pose_cells,
)
from spot3d.evaluate.peer import PEER, behind_peer, peer_in_frame
from spot3d.evaluate.scores import object_scores, without_object
from spot3d.evaluate.table import Table, columns
from spot3d.settings import Settings
from spot3d.source.sequence import FrameList

SHAKES = ((0.005, 0.2), (0.010, 0.4), (0.020, 0.8))
"""Pose errors in metres and degrees along each axis: from the best motion capture to a phone's odometry."""
DELAYS = (1, 2)
MOUNTS = ((0.010, 0.5), (0.020, 1.0))
"""Errors of a tracker's mounting in metres and degrees: measured with a ruler, or by eye."""
CENTRES = (0.0125, -0.025)
"""Shares of the width by which the stated principal point is too low. 16 pixels at VGA are the difference between the
driver's and a calibrated one of the Kinect of TUM's freiburg1."""
FOCALS = (1.015, 1.03)
"""Factors on the focal length: the driver's 525 pixels are 1.5 % off the calibrated 517 of TUM's freiburg1; and twice
that."""
NOISES = (2.0,)
SCALES = (0.985, 1.015, 0.97, 1.03)
"""Factors on depth: data sheets promise 2 % at two metres; ORB-SLAM2's authors (IEEE Trans. Robotics, 2017) found 4 %
on the Kinect of TUM's freiburg2."""
BENT = (0.006, 0.01)
"""Deviation of a camera's own distortion over its image, as a share of depth. With the first, odometry on rendered
desks drifts about half as much as on redkitchen, whose depth is 0.7 to 2.4 % too short for odometry left to itself."""
MIXED = (1, 2)
"""Radius in pixels over which resizing, and a usual smoothing filter, average depth at an edge."""
FATTENED = (1, 2)
"""Pixels by which near surfaces grow: stereo cameras match windows 5 to 9 pixels wide at VGA, half of it at half size.
"""
HOLES = (0.1, 0.3)
PHOTONS = (20, 0)
"""Photons of a white pixel: a small sensor in a room that is lit by a screen, and in the dark."""
BLURRED = 1 / 40
"""Share of the width over which colour is smeared: the camera turns by 45 degrees a second and exposes for 1/30 s."""
TOGETHER = 0.01, 0.4
"""Pose errors in metres and degrees that are combined with wrong depth scales: a hand-held camera under motion capture.
"""
EVERY = (1, 2, 3, 4, 5, 10, 20, 30)
"""Every nth frame, down to the one of 30 a second that a slow link or computer leaves."""

COLUMNS = (
    *columns("data", "worse", "method", "3D IoU", "3D SR", "3D DR"),
    *columns("AP", "AR", "F", digits=1),
    *columns("carried IoU", "carried SR", "carried DR"),
    *columns("carried F", "found", "no object", "true", digits=1),
    *POSES,
)

Levels = list[tuple[str, Degradation]]
OF_GIVEN_POSES = ("poses", "delay", "mount", "together")
"""Groups that do not apply if the system estimates its own poses."""
OF_FRAMES = ("centre", "focal", "scale", "bent", "depth", "edges", "holes", "colour")
"""Groups that a frame by itself can have."""


def groups(base: Degradation) -> dict[str, Levels]:
    """The levels of each kind of degradation, by kind: names and degradations, the undegraded `base` among them."""
    together = replace(base, metres=TOGETHER[0], degrees=TOGETHER[1])
    worst = replace(together, scale=SCALES[2], late=DELAYS[0], noise=NOISES[0])
    # These two errors mask each other.
    masked = replace(base, scale=SCALES[2], centre=-CENTRES[1])
    shakes = [(f"{1e3 * m:g} mm {d:g} deg", replace(base, metres=m, degrees=d)) for m, d in SHAKES]
    return {
        "poses": [("0 mm", base), *shakes],
        "delay": [("0 frames", base), *((f"{k} frames", replace(base, late=k)) for k in DELAYS)],
        "mount": [("0 mm", base), *((f"{1e3 * m:g} mm {d:g} deg", replace(base, mount=(m, d))) for m, d in MOUNTS)],
        "centre": [("0 px", base), *((f"{640 * k:+g} of 640 px", replace(base, centre=k)) for k in CENTRES)],
        "focal": [("x 1", base), *((f"x {k:g}", replace(base, focal=k)) for k in FOCALS)],
        "scale": [("x 1", base), *((f"x {k:g}", replace(base, scale=k)) for k in SCALES)],
        "bent": [("straight", base), *((f"{100 * k:g} %", replace(base, bent=k)) for k in BENT)],
        "depth": [("sigma x1", base), *((f"sigma x{k:g}", replace(base, noise=k)) for k in NOISES)],
        "edges": [
            ("sharp", base),
            *((f"{k} px", replace(base, mixed=k)) for k in MIXED),
            *((f"{k} px fatter", replace(base, fattened=k)) for k in FATTENED),
        ],
        "holes": [("0 %", base), *((f"{100 * k:g} %", replace(base, missing=k)) for k in HOLES)],
        "colour": [
            ("as it is", base),
            *((f"{k} photons", replace(base, photons=k)) for k in PHOTONS),
            (f"blurred over {640 * BLURRED:g} of 640 px", replace(base, blurred=BLURRED)),
        ],
        "every": [(f"every {k}", replace(base, every=k)) for k in EVERY],
        "together": [
            ("nothing", base),
            *((f"10 mm 0.4 deg, x {k:g}", replace(together, scale=k)) for k in SCALES[2:]),
            ("10 mm 0.4 deg, x 0.97, 1 frame late, sigma x2", worst),
            (f"x {masked.scale:g}, {640 * masked.centre:+g} of 640 px", masked),
        ],
        "half": [("as it is", base), ("half size", replace(base, half=True))],
    }


GROUPS = tuple(groups(Degradation()))

NOTE_WORSE = (
    "Poses: each axis off by a smooth random error of this deviation, correlated over 10 frames. Delay: of poses "
    "against images, in recorded frames. Mount: poses of a body fixed to the camera, displaced and rotated by so "
    "much. Centre: the stated principal point is that much lower in the image (true poses, by which objects are "
    "carried, are then not those of such a camera). Focal: the stated focal length is so many times as long. "
    "Scale: depth times a factor, as of a camera out of calibration. Bent: depth is too long in parts of the "
    "image and too short in others, by this deviation, alike in all frames. Depth: noise is added until its "
    "deviation is so many times that of a Kinect, 1.2 mm + 1.9 mm/m2 (z - 0.4 m)^2. Edges: depth is the mean of "
    "the pixels within so many, or near objects are wider by so many. Together: several of these at once. Holes: "
    "share of the measured pixels lost in blobs, others in each frame. Colour: a white pixel has so many "
    f"photons, or colour has motion blur in one direction, another one in each frame. All with seed {SEED}."
)


def robustness_table(
    datasets: list[DataSet], settings: Settings, every: int, only: tuple[str, ...], say: Callable[[str], None]
) -> Table:
    """Whole runs of ours and of the peer on degraded sequences, with curves over each kind (not in the paper).

    datasets: with all frames of the sequences; every: the undegraded run takes each nth of them. only: which of GROUPS.
    Errors of given poses are left out if the system estimates its own.
    """
    table = Table("robustness", "Objects of whole runs with degraded input", COLUMNS)
    own = settings.pose.provider != "given"
    base = Degradation(every=every)
    for dataset in datasets:
        items = [item for item in dataset.sequences if item.truth is not None]
        done: dict[Degradation, list[MeasuredRun]] = {}
        kinds = {kind: levels for kind, levels in groups(base).items() if kind in only}
        chosen = {kind: levels for kind, levels in kinds.items() if not (own and kind in OF_GIVEN_POSES)}
        if dataset.halved and "half" in chosen:
            del chosen["half"]
            table.notes.append(f"{dataset.name}: not measured at half size again, as its frames are so already.")
        camera = items[0].sequence.intrinsics
        table.notes.append(
            f"{dataset.name}: {len(items[0].sequence)} frames of {camera.width}x{camera.height}, every {every} "
            f"unless stated; poses: {settings.pose.provider}."
        )
        for level, worse in _distinct(base, chosen).items():
            say(f"{dataset.name}, worse: {worse} ...")
            done[level] = [measure(replace(item, sequence=level.of(item.sequence)), settings) for item in items]
            _add(table, dataset.name, worse, done[level])
        for kind, levels in chosen.items():
            table.curves += _curves(f"{dataset.name} {kind}", [(name, done[level]) for name, level in levels])
    if own and set(only) & set(OF_GIVEN_POSES):
        table.notes.append("Shaken, late and misplaced poses are given poses; with odometry these rows are left out.")
    table.notes += [
        NOTE_WORSE,
        NOTE_NO_OBJECT,
        NOTE_CARRIED,
        NOTE_POSES,
        NOTE_PEER,
    ]
    return table


def frame_robustness_table(
    datasets: list[DataSet], settings: Settings, every: int, only: tuple[str, ...], say: Callable[[str], None]
) -> Table:
    """Single frames of ours and of the peer with degraded input, with curves over each kind (not in the paper).

    only: which kinds; those that need several frames are left out. A camera's own errors are alike in all frames.
    """
    heads = (*columns("data", "worse"), *BOTH_METHODS)
    table = Table("robustness-frames", "Single frame: success and detection rate with degraded input", heads)
    base = Degradation()
    kinds = {kind: levels for kind, levels in groups(base).items() if kind in only and kind in OF_FRAMES}
    for dataset in datasets:
        items = [read() for read in dataset.readers[::every]]
        frames = FrameList(item.frame for item in items)
        done: dict[Degradation, tuple[FoundInFrames, FoundInFrames]] = {}
        for level, worse in _distinct(base, kinds).items():
            say(f"{dataset.name}, worse: {worse} ...")
            ours, peer = done[level] = FoundInFrames(), FoundInFrames()
            for item, frame in zip(items, level.of(frames), strict=True):
                _, heat = proposals_and_heat(frame, settings)
                ours.add(item, boxes_in_frame(frame, heat, settings))
                peer.add(item, peer_in_frame(frame.depth_metres(), frame.intrinsics, settings.fusion.size_max))
            table.add(dataset.name, worse, *ours.cells(), *peer.cells(), peer.true)
            table.notes += ours.behind(peer, f"{dataset.name}, worse: {worse}")
        for kind, levels in kinds.items():
            places, names = np.linspace(0, 1, len(levels)), tuple(name for name, _ in levels)
            for method, which in ((OURS, 0), (PEER, 1)):
                detection = np.array([done[level][which].scores.detection for _, level in levels])
                table.curves.append(Curve(f"{dataset.name} {kind}", f"{method} detection", places, detection, names))
    table.notes += [NOTE_WORSE, "Errors that need several frames are left out."]
    return table


def _distinct(base: Degradation, kinds: dict[str, Levels]) -> dict[Degradation, str]:
    """Each level of these kinds once, by its first name; the undegraded one comes first."""
    named = {base: "nothing"}
    for kind, levels in kinds.items():
        for name, level in levels:
            named.setdefault(level, f"{kind}: {name}")
    return named


def _add(table: Table, data: str, worse: str, runs: list[MeasuredRun]) -> None:
    methods = by_method(runs)
    for method, done in methods.items():
        fixed, carried = [one.fixed.iou for one in done], [one.carried.iou for one in done]
        a, b = object_scores(fixed), object_scores(carried)
        points = point_cells(done)
        found, true = (float(np.mean([iou.shape[axis] for iou in fixed])) for axis in (1, 0))
        cells = (a.iou, a.success, a.detection, *points[:3], b.iou, b.success, b.detection, points[5])
        table.add(data, worse, method, *cells, found, without_object(fixed), true, *pose_cells(runs))
    measures = [*overlap_measures(*methods.values()), *point_measures(*methods.values())]
    table.notes += behind_peer(f"{data}, worse: {worse}", measures)


def _curves(data: str, levels: list[tuple[str, list[MeasuredRun]]]) -> list[Curve]:
    """Detection rate, and F over 100, of both methods over the levels. Empty for a single level."""
    if len(levels) < 2:
        return []
    names = tuple(name for name, _ in levels)
    places = np.linspace(0, 1, len(levels))
    curves, methods = [], [by_method(runs) for _, runs in levels]
    for method in (OURS, PEER):
        done = [of_level[method] for of_level in methods]
        detection = [object_scores([one.fixed.iou for one in some]).detection for some in done]
        f_measure = [point_cells(some)[2] / 100 for some in done]
        curves += [
            Curve(data, f"{method} detection", places, np.array(detection), names),
            Curve(data, f"{method} F / 100", places, np.array(f_measure), names),
        ]
    return curves
