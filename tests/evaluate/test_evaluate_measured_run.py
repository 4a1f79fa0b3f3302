"""What a run over a labelled sequence is measured by, beside its objects."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from table_frame import CAMERA, table_depth

from spot3d import pipeline
from spot3d.calibration import Calibration
from spot3d.evaluate import still_table as still_table_module
from spot3d.evaluate.degraded import Degradation
from spot3d.evaluate.labelled import DataSet, LabelledFrame, LabelledSequence, mask_boxes
from spot3d.evaluate.measured_run import measure
from spot3d.evaluate.still_table import moving_table, still_table
from spot3d.evaluate.truth import LabelledScene
from spot3d.failures import Failures, StageFailedError
from spot3d.found_object import FoundObjects
from spot3d.frame import RgbdFrame
from spot3d.heatmap.heat import Heatmap
from spot3d.pipeline import PipelineStep
from spot3d.pose.estimate import PoseEstimate
from spot3d.settings import Settings
from spot3d.source.scene.scene import Scene
from spot3d.source.sequence import FrameList, FrameSequence


def test_a_run_tells_how_far_off_its_cameras_are_and_how_many_frames_are_lost() -> None:
    """Every other frame of the second half is dark, and a quarter of a second is lost; the rest is followed."""
    seen = list(Degradation(half=True).of(Scene(2, frames=24)))
    blank = [replace(frame, depth=np.zeros_like(frame.depth)) for frame in seen]
    frames = FrameList([blank[i] if i >= 12 and i % 2 else frame for i, frame in enumerate(seen)])
    run = measure(LabelledSequence("dark", frames, None), Settings().changed("pose", provider="kiss"))
    assert run.lost == pytest.approx(6 / 24)
    assert 0 < run.ate < 0.005


def test_given_poses_are_as_far_off_as_they_are() -> None:
    sequence = Degradation(half=True, metres=0.02, degrees=0.0).of(Scene(2, frames=24))
    settings = Settings().changed("pose", provider="given", given_sigma=0.0)
    run = measure(LabelledSequence("shaken", sequence, None), settings)
    assert run.lost == 0
    assert 0.01 < run.ate < 0.05


def test_where_nothing_is_labelled_an_object_both_are_charged_in_the_true_world() -> None:
    """Odometry begins in a world of its own, as the first frame has no pose; boxes are upright in the true one."""
    seen = list(Degradation(half=True).of(Scene(2, frames=24)))[:8]
    frames = FrameList([replace(seen[0], T_world_camera=None), *seen[1:]])
    nothing = LabelledScene((), (), (), np.array((0.0, 0.0, 1.0)), np.zeros((0, 3), np.float32), np.zeros(0, np.uint8))
    run = measure(LabelledSequence("nothing", frames, nothing), Settings().changed("pose", provider="kiss"))
    for found in (run.ours.fixed, run.peer.fixed):
        assert len(found.boxes) >= 2
        assert min(box.rotation[2, 2] for box in found.boxes) > 0.99


def of_frame(table: Callable[[list[DataSet], Settings], object]) -> Callable[[Scene, Settings], object]:
    """The table of a scene's first frame."""

    def made(scene: Scene, settings: Settings) -> object:
        return table([DataSet("scene", (lambda: LabelledFrame(scene[0], np.zeros((0, 4))),))], settings)

    return made


@pytest.mark.parametrize(
    "measured",
    [
        lambda scene, settings: measure(LabelledSequence("scene", scene, None), settings),
        of_frame(still_table),
        of_frame(moving_table),
    ],
    ids=["sequence", "still", "moving"],
)
def test_a_run_in_which_a_stage_fails_is_not_measured(
    measured: Callable[[Scene, Settings], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise ValueError("one odd frame")

    monkeypatch.setattr(pipeline, "weighted_heat", fails)
    with pytest.raises(
        StageFailedError, match=r"\d+ of heatmap, the last one: no heat for .*: ValueError: one odd frame"
    ):
        measured(Scene(2, frames=2), Settings())


def test_the_moving_cameras_peer_has_what_the_run_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run knows that depth is 10 % too short, and has moved its map; its last, lost pose counts for nothing."""
    T_world_map = np.eye(4)
    T_world_map[0, 3] = 0.1

    def made(sequence: FrameSequence, _: Settings, follow: Callable[[PipelineStep], None]) -> SimpleNamespace:
        trajectory = []
        for number, frame in enumerate(sequence):
            moved_by = T_world_map if number else np.eye(4)
            known = Calibration(depth_factor=1.1)
            pose = PoseEstimate(moved_by @ frame.T_world_camera, "ok", calibration=known, T_world_map=moved_by)
            trajectory.append((frame.stamp_ns, pose))
            short = replace(frame, depth=frame.depth / np.float32(1.1))
            follow(PipelineStep(short, pose, Heatmap(np.zeros(CAMERA.shape, np.uint8), 0, 0, 0), None, None, "", ""))
        stamp_ns, _ = trajectory[-1]
        trajectory[-1] = (stamp_ns, PoseEstimate(far, "lost"))
        return SimpleNamespace(
            trajectory=trajectory, objects=FoundObjects([], np.array((0.0, 0.0, 1.0)), 12), failures=Failures()
        )

    far = np.eye(4)
    far[0, 3] = 5.0
    monkeypatch.setattr(still_table_module, "run_pipeline", made)
    depth, shown = table_depth()
    frame = RgbdFrame(0, np.zeros((*depth.shape, 3), np.uint8), depth, 1.0, CAMERA)
    table = moving_table([DataSet("table", (lambda: LabelledFrame(frame, mask_boxes(shown, 2)),))], Settings())
    detection = [column.name for column in table.columns].index("peer DR")
    assert table.rows[0][detection] == 1
