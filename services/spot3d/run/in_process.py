"""A run of the composed cores in this process, without Zenoh."""

import time
from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np

from spot3d.colour_alignment import AlignmentWatch
from spot3d.dataflow.process_use import process_use, stay_single_threaded
from spot3d.found_object import FoundObjects
from spot3d.pipeline import PipelineResult, PipelineStep, run_pipeline
from spot3d.pose.estimate import GIVEN_JUMPED, GIVEN_TOO_FAR
from spot3d.run.display import RunMonitor
from spot3d.run.lost_tracking import LostTracking
from spot3d.run.report import FrameRate, StageReport, statistics_ms
from spot3d.run.results import MapSnapshot, RunResult, TrackedFrame
from spot3d.segments.upper_side import event_of, notice
from spot3d.settings import Settings
from spot3d.source.errors import WITHOUT_POSE
from spot3d.source.sequence import FrameSequence


def run_in_process(sequence: FrameSequence, settings: Settings, monitor: RunMonitor) -> RunResult:
    """Process every frame, or until `stop` is set; fills the report."""
    stay_single_threaded()
    report, files, stop = monitor.report, monitor.files, monitor.stop
    fused, found, side_up = 0, 0, ""
    rate, lost, alignment = FrameRate(), LostTracking(), AlignmentWatch()
    events: defaultdict[str, Counter[str]] = defaultdict(Counter)
    # Looked up once: without poses, the whole recording is searched.
    has_true_poses = sequence.has_true_poses

    def tell(stage: str, event: str, text: str) -> None:
        events[stage][event] += 1
        monitor.tell(text)

    def follow(step: PipelineStep) -> None:
        nonlocal fused, found, side_up
        is_lost = step.pose.status == "lost"
        lost.add(step.frame.stamp_ns, is_lost, step.pose.reason)
        fused += not step.refused
        if not is_lost:
            files.add_pose(step.frame.stamp_ns, step.pose.T_world_camera)
        found = found if step.objects is None else len(step.objects.objects)
        if step.objects is not None:
            files.add_update(step.frame.stamp_ns, _found(step.objects), complete=False)
        if step.side_up and not side_up:
            side_up = step.side_up
            tell("segments", event_of(side_up), notice(side_up))
        if step.pose.remark:
            tell("pose", GIVEN_TOO_FAR, step.pose.remark)
        if step.pose.restarted:
            events["pose"][GIVEN_JUMPED] += 1
        if off := alignment.look(step.frame):
            tell("proposals", AlignmentWatch.EVENT, off)
        if has_true_poses and step.frame.T_world_camera is None:
            events["source"][WITHOUT_POSE] += 1
        rate.add(fused + lost.frames, time.monotonic())
        monitor.watcher.on_progress(fused, lost.frames, found)

    result = run_pipeline(sequence, settings, follow, stop.is_set)
    if result.trajectory and result.complete:
        files.add_update(result.trajectory[-1][0], _found(result.objects), complete=not stop.is_set())
    use, run = process_use(), _run_result(result)
    report.proposals = dict(result.heat_counts)
    report.keyframes = result.keyframes
    report.ms_per_frame = rate.ms_per_frame()
    report.interrupted = stop.is_set()
    report.fused, report.skipped = result.fusion.frame_count, dict(result.skipped)
    report.lost_poses, report.lost = lost.frames, lost.stretches()
    failures = result.failures
    report.stages = {
        stage: StageReport(
            step_ms=dict(statistics_ms([1e3 * seconds for seconds in result.step_s.get(stage, ())])),
            events=dict(events[stage]),
            errors=failures.errors[stage],
            last_error=failures.last_error.get(stage, ""),
        )
        for stage in dict.fromkeys(("source", *result.step_s, *failures.errors))
    }
    if result.unreadable:
        report.stages["source"].last_error = result.unreadable
    if not result.complete:
        report.error = report.useless_stage() or (
            f"the last update of the objects failed: {failures.last_error['fusion']}"
        )
    report.stages["all"] = StageReport(cpu_s=use.cpu_s, rss_mb=use.rss_bytes / 2**20)
    return run


def _found(objects: FoundObjects) -> RunResult:
    """The objects of an update."""
    return RunResult(
        objects=tuple(objects.objects),
        up=(float(objects.up[0]), float(objects.up[1]), float(objects.up[2])),
        frame_count=objects.frame_count,
        left_out=dict(objects.left_out),
        keyframes_dropped=objects.keyframes_dropped,
    )


def _run_result(result: PipelineResult) -> RunResult:
    points = result.fusion.frequent_points()
    return replace(
        _found(result.objects),
        map_limit_reached=result.fusion.heatmap.evicted > 0,
        trajectory=tuple(
            TrackedFrame(stamp, pose.T_world_camera, pose.status == "lost", pose.delay_s, pose.calibration)
            for stamp, pose in result.trajectory
        ),
        points=MapSnapshot(
            points.xyz,
            np.rint(points.colour).astype(np.uint8),
            points.heat,
            points.frequency.astype(np.uint32),
            result.fusion.heatmap.count,
        ),
    )
