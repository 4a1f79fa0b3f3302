"""Tables of time by stage (paper, Table II) and of camera poses."""

import importlib.util
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from spot3d.evaluate.datasets import both_sizes
from spot3d.evaluate.labelled import DataSet, LabelledSequence
from spot3d.evaluate.measured_run import Runs
from spot3d.evaluate.table import Cell, Column, Table, columns
from spot3d.pose.providers import make_tracker
from spot3d.pose.settings import PoseSettings
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.trajectory import ate, rpe
from spot3d_schemas import STAGES

TIMED = (*STAGES[1:], "objects")


def time_table(datasets: list[DataSet], settings: Settings, runs: Runs) -> Table:
    """Mean time of each stage for a frame, at VGA and half size (paper, Table II)."""
    heads = (*columns("data", "size"), *columns(*(f"{stage} ms" for stage in (*TIMED, "all")), digits=1))
    table = Table("time", "Time for a frame by stage (paper, Table II)", heads)
    for dataset, size in both_sizes(datasets):
        done = [runs.run(item, settings) for item in dataset.sequences]
        frames = sum(max(1, run.frames - 1) for run in done)
        means = [1e3 * sum(sum(run.step_s.get(stage, ())) for run in done) / frames for stage in TIMED]
        table.add(dataset.name, size, *means, sum(means))
    table.notes.append(
        "One thread, in one process, reading not included. Objects: all updates' time, shared by the frames. "
        f"Poses: {settings.pose.provider}. The paper: 3030 ms at VGA, 973 ms at half size."
    )
    return table


def poses_table(datasets: list[DataSet], settings: Settings, say: Callable[[str], None]) -> Table:
    """ATE and RPE, by evo's definitions, of each pose provider, and its time for a frame."""
    heads = (*columns("data", "provider"), Column("ATE mm", 1), Column("RPE mm", 2), Column("RPE deg", 3))
    heads += (Column("RPE median mm", 2), Column("RPE median deg", 3), *columns("lost %", "ms a frame", digits=1))
    table = Table("poses", "Camera poses", heads)
    installed = importlib.util.find_spec("small_gicp") is not None
    for item in (item for dataset in datasets for item in dataset.sequences):
        if not item.sequence.has_true_poses:
            table.notes.append(f"{item.name} has no true poses.")
            continue
        for provider in ("kiss", "gicp") if installed else ("kiss",):
            say(f"{item.name}, poses by {provider} ...")
            table.add(item.name, provider, *_pose_cells(item, settings.pose.model_copy(update={"provider": provider})))
    table.notes.append("Root mean square, all pairs of neighbouring frames played; ATE after rigid alignment.")
    if not installed:
        table.notes.append("gicp is left out: small_gicp is not installed (pip install 'spot3d[gicp]').")
    return table


def _pose_cells(item: LabelledSequence, settings: PoseSettings) -> tuple[Cell, ...]:
    tracker, true, found, times = make_tracker(settings), [], [], []
    for index in range(len(item.sequence)):
        frame = item.sequence[index]
        start = time.perf_counter()
        pose = tracker.track(replace(frame, T_world_camera=None))
        times.append(time.perf_counter() - start)
        if pose.status == "ok" and frame.T_world_camera is not None:
            true.append(frame.T_world_camera)
            found.append(pose.T_world_camera)
    if not times:
        raise SourceError(f"{item.name} has no frames")
    lost, ms = 100 * (1 - len(found) / len(times)), 1e3 * float(np.mean(times[1:] or times))
    if len(found) < 2:
        return None, None, None, None, None, lost, ms
    shift, turn = rpe(np.array(true), np.array(found))
    return (
        1e3 * ate(np.array(true), np.array(found))["rmse"],
        1e3 * shift["rmse"],
        float(np.degrees(turn["rmse"])),
        1e3 * shift["median"],
        float(np.degrees(turn["median"])),
        lost,
        ms,
    )
