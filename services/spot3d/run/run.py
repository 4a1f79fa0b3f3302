"""`spot3d run`: turns an input into a folder of results."""

import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console

from spot3d import missing_package
from spot3d.dataflow.stopping import stop_on_signals
from spot3d.drawing.overview import candidate_indices
from spot3d.run.display import RunMonitor, progress_bar
from spot3d.run.distributed import Plan, run_distributed
from spot3d.run.earlier_streams import forget_streams
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.input_doubts import input_doubts
from spot3d.run.overview import OverviewFrames, View, write_overview
from spot3d.run.report import RunReport, report_document
from spot3d.run.results import RESULTS, RunResult, write_json, write_results
from spot3d.run.sole_writer import sole_writer
from spot3d.run.stage_files import SNAPSHOTS, delete_logs, delete_snapshots
from spot3d.run.supervisor import Supervisor
from spot3d.settings import Settings, to_toml
from spot3d.source.errors import NOT_PLAYED, SourceError
from spot3d.source.image_limit import refuse_large_images
from spot3d.source.selected import Selection, open_selected_stream, open_selection
from spot3d.source.sequence import FrameList, FrameSequence
from spot3d.source.sequences import is_stream

_UNFINISHED = "the run is still in progress, was killed, or could not begin"
"""The report's error until the run has ended."""
_OVERVIEW = "overview.png"
_PACKAGES = {"kiss": ("scipy", "kiss_icp"), "gicp": ("scipy", "small_gicp"), "given": ("scipy",)}
"""Packages that only stages import, by pose provider."""


@dataclass(frozen=True, slots=True)
class Finished:
    """A run's result and report; `folder` holds the files, including overview.png.

    sequence: of a camera its first frame, if one came.
    """

    folder: Path
    sequence: FrameSequence
    result: RunResult
    report: RunReport


def run(
    selection: Selection,
    settings: Settings,
    folder: Path,
    console: Console,
    in_process: bool = False,
    pose_topic: str | None = None,
    listen: Sequence[str] = (),
    usual: str | None = None,
    accepted: Callable[[], None] | None = None,
) -> Finished:
    """Play the input through all stages and write every result file into `folder`.

    pose_topic: key of external poses. listen: endpoints for other programs. usual: one more, if it is free.
    accepted: is called as soon as it is certain that the input can be played into `folder`.
    Ctrl-C (SIGINT) or SIGTERM end the stages at once; the results so far are written all the same.
    Raises SourceError for an input that cannot be played, or if another run writes into `folder`, OSError if that
    cannot be written, and ModuleNotFoundError if a stage's package is not installed.
    """
    # A stage that lacks it would say so, but when the results of an earlier run are deleted.
    missing_package.refuse_missing(*_PACKAGES["given" if pose_topic is not None else settings.pose.provider])
    _refuse_other_than_utf8(folder)
    with nullcontext() if in_process else Supervisor() as supervisor:
        name = selection.name
        seen = OverviewFrames(settings.link.robot) if is_stream(name) else None
        if seen is None:
            sequence: FrameSequence = open_selection(selection, settings.source)
        else:
            # The source's process opens it as well; here it is refused before earlier results are deleted.
            open_selected_stream(selection, settings.source)
            sequence = FrameList()
        if not in_process and seen is None:
            refuse_large_images(sequence.intrinsics, settings.source.halved)
        if settings.pose.provider == "given" and not sequence.has_true_poses and pose_topic is None:
            raise SourceError(f"{name} has no true poses; choose --pose kiss or --pose gicp")
        with sole_writer(folder):
            if accepted is not None:
                accepted()
            console.print(f"writing results to {folder}", markup=False, highlight=False, soft_wrap=True)
            plan = Plan(selection, settings, folder, pose_topic, tuple(listen), usual, seen, sequence.stamps_ns)
            return _run(sequence, plan, console, supervisor)


def _refuse_other_than_utf8(folder: Path) -> None:
    """The stages' settings contain the folder's name, and must be UTF-8."""
    try:
        str(folder.absolute()).encode()
    except UnicodeEncodeError as error:
        raise SourceError(f"{str(folder)!a} is not a valid UTF-8 path; give another folder with --out") from error


def _run(sequence: FrameSequence, plan: Plan, console: Console, supervisor: Supervisor | None) -> Finished:
    selection, settings, folder, seen = plan.selection, plan.settings, plan.folder, plan.seen
    in_process = supervisor is None
    odometry = settings.pose.provider != "given" and plan.pose_topic is None
    # Before the results of an earlier run are deleted: it takes seconds, in which Ctrl-C may end it.
    doubts = input_doubts(sequence, odometry) if seen is None else []
    (folder / "settings.toml").write_text(to_toml(settings), encoding="utf-8")
    size = (sequence.intrinsics.width, sequence.intrinsics.height) if seen is None else (0, 0)
    mode = "in process" if in_process else "processes"
    played = len(sequence) if seen is None else selection.frames or 0
    report = RunReport(selection.name, mode, played, size, asdict(_from_anywhere(selection)))
    _begin(folder, report)
    start_s = time.perf_counter()
    with (
        stop_on_signals(None) as stop,
        progress_bar(played or None, console) as watcher,
        GrowingFiles(folder) as files,
    ):
        monitor = RunMonitor(report, files, watcher, stop)
        monitor.tell(*doubts)
        if supervisor is None:
            # The cores take a second to import, which would delay the start of the stages.
            from spot3d.run.in_process import run_in_process

            result = run_in_process(sequence, settings, monitor)
        else:
            _write_stages_settings(plan)

            def keep(result: RunResult) -> None:
                try:
                    _write_report(folder, result, replace(report, error=_UNFINISHED), time.perf_counter() - start_s)
                    write_results(folder, result)
                except OSError as error:
                    watcher.on_event(f"cannot save the results so far: {error}")

            result = run_distributed(plan, supervisor, monitor, keep)
    monitor.tell(*files.notices())
    if not (report.error or report.interrupted):
        report.close()
    skipped = report.skipped
    not_played = [f"{skipped[why]} of {report.played} frames {why}" for why in NOT_PLAYED if why in skipped]
    if not_played and not report.error:
        report.error = f"{', '.join(not_played)}; the last error: {report.stages['source'].last_error}"
    report.error = report.error or report.useless_stage()
    if not (report.fused or report.error or report.interrupted):
        report.error = report.nothing_fused()
    if in_process:
        # Logs of an earlier run's processes would be taken for this one's.
        delete_logs(folder)
    name = Path(selection.name).name or selection.name
    camera_path = np.array([item.T_world_camera[:3, 3] for item in result.path()]).reshape(-1, 3)
    wall_s = time.perf_counter() - start_s
    views = _views(sequence, result) if seen is None else seen.views
    known = result.calibration()
    views = [(replace(frame, intrinsics=known.camera(frame.intrinsics)), pose) for frame, pose in views]
    try:
        write_results(folder, result)
        if not_drawn := write_overview(folder / _OVERVIEW, name, views, result, camera_path):
            monitor.tell(not_drawn)
    except OSError as error:
        report.error = report.error or f"cannot write all results: {error}"
        with suppress(OSError):
            _write_report(folder, result, report, wall_s)
        raise
    # Last: a reader that sees that the run has ended well finds all of its files.
    _write_report(folder, result, report, wall_s)
    delete_snapshots(folder)
    if seen is not None and seen.first is not None:
        sequence = FrameList([seen.first])
    return Finished(folder, sequence, result, report)


def _from_anywhere(selection: Selection) -> Selection:
    """The selection with the whole path of its folder or file, for who exports the run from another folder."""
    path = Path(selection.name)
    return replace(selection, name=str(path.absolute())) if path.exists() else selection


def _begin(folder: Path, report: RunReport) -> None:
    """Mark the run as unfinished in the report, and delete the results of an earlier run."""
    write_json(folder / "report.json", report_document(replace(report, error=_UNFINISHED), RunResult()))
    for name in (*RESULTS, _OVERVIEW):
        (folder / name).unlink(missing_ok=True)
    forget_streams(folder)


def _write_report(folder: Path, result: RunResult, report: RunReport, wall_s: float) -> None:
    """Write the report of what was found. Raises OSError."""
    report.wall_s = wall_s
    write_json(folder / "report.json", report_document(report, result))


def _write_stages_settings(plan: Plan) -> None:
    """Write the settings for the stages of this run, which keep their snapshots in its own folder."""
    delete_snapshots(plan.folder)
    snapshots = plan.settings.link.snapshot_folder or str((plan.folder / SNAPSHOTS).absolute())
    plan.logs.mkdir(exist_ok=True)
    stages = plan.settings.changed("link", snapshot_folder=snapshots)
    plan.settings_file.write_text(to_toml(stages), encoding="utf-8")


def _views(sequence: FrameSequence, result: RunResult) -> list[View]:
    """Frames with a trusted pose, over the whole run; a frame that can no longer be read is left out."""
    index_of = {stamp: index for index, stamp in enumerate(sequence.stamps_ns)}
    tracked = [item for item in result.path() if item.stamp_ns in index_of]
    views = list[View]()
    for chosen in candidate_indices(len(tracked)):
        with suppress(SourceError):
            item = tracked[chosen]
            views.append((sequence[index_of[item.stamp_ns]], item.T_world_camera))
    return views
