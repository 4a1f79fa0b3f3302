"""Time and accuracy of the pose stage, and of KISS-ICP without changes."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.kiss_icp import KissICP
from numpy.typing import NDArray

from spot3d.bench.material import Material
from spot3d.bench.timing import MEASURED, Timing, measured_row, summary
from spot3d.camera import back_project
from spot3d.evaluate.table import Column, Table
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.trajectory import rpe

REFERENCES = {"KISS-ICP's defaults, every 2nd pixel": 100.0, "the same, with a range of 5 m": 5.0}
"""Range of KISS-ICP, metres: its default, for lidars, and a depth camera's. Its voxels are a hundredth of it."""


def pose_table(materials: Sequence[Material], settings: PoseSettings, say: Callable[[str], None]) -> Table:
    """Times and errors of ours and of KISS-ICP with its own defaults, frame by frame in alternation."""
    columns = (*MEASURED, Column("RPE mm"), Column("reference RPE mm"))
    table = Table("pose", "Pose of a frame", columns)
    for material in materials:
        say(f"pose: {material.data}, {material.size} ...")
        for name, range_max in REFERENCES.items():
            table.add(*_pose_row(material, settings, name, range_max))
    table.notes.append(
        "RPE: root mean square error of the shift between neighbouring frames. Compare a reference's time together "
        "with its RPE. Both on one thread."
    )
    return table


def _pose_row(
    material: Material, settings: PoseSettings, name: str, range_max: float
) -> tuple[str | float | None, ...]:
    tracker, plain = make_tracker(settings), _plain_kiss(range_max)
    ours, theirs, copy = _Stopwatch(), _Stopwatch(), _Stopwatch()
    true, tracked, plain_poses = [], [], []
    for index, frame in enumerate(material.frames):
        depth = material.depth[index]
        with ours:
            estimate = tracker.track(replace(frame, T_world_camera=None))
        with theirs:
            plain.register_frame(_every_second(depth, material), np.empty(0))
        with copy:
            depth.copy()
        true.append(material.pose(index))
        tracked.append(estimate.T_world_camera)
        plain_poses.append(plain.last_pose.copy())
    errors: list[float | None] = [None, None]
    if len(true) > 1:
        errors = [1e3 * rpe(np.array(true), np.array(found))[0]["rmse"] for found in (tracked, plain_poses)]
    timings = [item.summary() for item in (ours, theirs, copy)]
    row = measured_row(material.data, material.size, "pose", timings[0], name, timings[1], timings[2])
    return *row, *errors


class _Stopwatch:
    """Collects the times of its `with` blocks; the first is left out, as it starts the map."""

    def __init__(self) -> None:
        self._wall: list[float] = []
        self._cpu: list[float] = []

    def __enter__(self) -> None:
        self._start = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        self._wall.append(time.perf_counter() - self._start[0])
        self._cpu.append(time.process_time() - self._start[1])

    def summary(self) -> Timing:
        """Timing of all blocks but the first."""
        return summary(self._wall[1:] or self._wall, self._cpu[1:] or self._cpu)


def _plain_kiss(range_max: float) -> KissICP:
    config = KISSConfig()
    config.data.max_range = range_max
    config.mapping.voxel_size = range_max / 100
    config.registration.max_num_threads = 1
    return KissICP(config)


def _every_second(depth: NDArray[np.float32], material: Material) -> NDArray[np.float64]:
    points = back_project(depth, material.camera)[::2, ::2].reshape(-1, 3)
    return points[points[:, 2] > 0].astype(np.float64)
