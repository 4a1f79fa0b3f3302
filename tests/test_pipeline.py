"""All cores in one process: what a distributed run refuses is refused here, for the same reasons."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE, ROOM, THREE, look_at, view
from numpy.typing import NDArray

from spot3d import pipeline
from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.fusion.fusion import Fusion
from spot3d.pipeline import PipelineResult, PipelineStep, run_pipeline
from spot3d.pose.given import GivenPoses
from spot3d.segments.keyframe_segments import KeyframeSegments
from spot3d.settings import load_settings
from spot3d.source.scene.model import TrueBox, build_scene
from spot3d.source.scene.scene import Scene
from spot3d.source.selected import Selected
from spot3d.source.sequence import FrameList

MS = 1_000_000
SETTINGS = load_settings(overrides={"pose": {"provider": "given"}}).model_copy(update={"fusion": COARSE})


def recording(stamps: tuple[int, ...], off: tuple[float, ...]) -> FrameList:
    """A table with things, seen at these stamps, milliseconds, by a camera whose poses are said to be `off` metres
    beside where it is."""
    frames = []
    for index, (stamp, aside) in enumerate(zip(stamps, off, strict=True)):
        pose = look_at((0.02 * index, -0.95, 0.7))
        seen = view(pose, ROOM + THREE, np.random.default_rng(index))
        told = pose.copy()
        told[0, 3] += aside
        frames.append(RgbdFrame(stamp * MS, seen.colour, seen.depth, 1.0, CAMERA, told))
    return FrameList(frames)


def run(stamps: tuple[int, ...], off: tuple[float, ...] | None = None) -> tuple[PipelineResult, list[PipelineStep]]:
    steps: list[PipelineStep] = []
    return run_pipeline(recording(stamps, off or (0.0,) * len(stamps)), SETTINGS, steps.append), steps


def test_frames_whose_stamps_are_not_later_are_skipped() -> None:
    result, steps = run((0, 33, 33, 20, 66, 66, 50, 100))
    assert result.skipped == {"duplicate stamp in the input": 2, "out of order in the input": 2}
    assert [step.frame.stamp_ns for step in steps] == [0, 33 * MS, 66 * MS, 100 * MS]
    assert result.fusion.frame_count == len(result.trajectory) == 4


def test_a_frame_that_cannot_be_read_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the error is: a disk that hiccups costs a frame."""
    frames = recording((0, 33, 66), (0.0,) * 3)

    def hiccup(_self: FrameList, index: int) -> RgbdFrame:
        if index == 1:
            raise OSError("the disk hiccups")
        return frames.frames[index]

    monkeypatch.setattr(FrameList, "__getitem__", hiccup)
    result = run_pipeline(frames, SETTINGS)
    assert (result.skipped, result.unreadable) == ({"cannot be read": 1}, "the disk hiccups")
    assert result.fusion.frame_count == 2


def test_only_keyframes_images_are_kept_for_their_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    fuse, kept = Fusion.fuse, list[bool]()

    def fused(*given: Any) -> Any:
        kept.append(given[-1] is not None)
        return fuse(*given)

    monkeypatch.setattr(Fusion, "fuse", fused)
    _, steps = run((0, 33, 66, 1100))
    assert kept == [step.segments is not None for step in steps] == [True, False, False, True]


def failing(monkeypatch: pytest.MonkeyPatch, owner: object, name: str, call: int) -> None:
    """Have a core fail once: the call of this number, from 1."""
    works, calls = getattr(owner, name), itertools.count(1)

    def fails_once(*given: Any, **more: Any) -> Any:
        if next(calls) == call:
            raise ValueError("one odd frame")
        return works(*given, **more)

    monkeypatch.setattr(owner, name, fails_once)


@pytest.mark.parametrize(
    ("owner", "name", "stage", "skipped", "said"),
    [
        (GivenPoses, "track", "pose", {"lost pose": 1}, "no pose of the frame at 33000000 ns"),
        (pipeline, "propose", "proposals", {}, "no proposals for the frame at 33000000 ns"),
        (pipeline, "weighted_heat", "heatmap", {}, "no heat for the frame at 33000000 ns"),
        (Fusion, "fuse", "fusion", {"error": 1}, "cannot fuse the frame at 33000000 ns"),
    ],
)
def test_a_frame_that_a_core_fails_on_costs_what_the_core_would_have_made_of_it(
    owner: object, name: str, stage: str, skipped: dict[str, int], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, owner, name, 2)
    result, steps = run((0, 33, 66, 100))
    assert (result.skipped, result.failures.errors) == (skipped, {stage: 1})
    assert result.failures.last_error == {stage: f"{said}: ValueError: one odd frame"}
    assert [bool(step.refused) for step in steps] == [False, bool(skipped), False, False]
    assert result.fusion.frame_count == 4 - len(skipped)
    assert [pose.reason for _, pose in result.trajectory if pose.reason] == ["ValueError: one odd frame"] * (
        stage == "pose"
    )
    assert [len(result.step_s[name]) for name in (stage, "source")] == [3, 4]
    assert [bool(step.heat.heat.any()) for step in steps] == [True, stage not in ("proposals", "heatmap"), True, True]
    assert result.complete


@pytest.mark.parametrize(
    ("owner", "name", "stage", "said"),
    [
        (KeyframeSegments, "find", "segments", "no segments of the frame at 0 ns"),
        (Fusion, "observe", "fusion", "cannot use the segments of the frame at 0 ns"),
    ],
)
def test_a_keyframe_that_a_core_fails_on_is_fused_without_its_segments(
    owner: object, name: str, stage: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stamps = (0, 33, 66, 1100)
    expected, _ = run(stamps)
    failing(monkeypatch, owner, name, 1)
    result, _ = run(stamps)
    assert result.failures.last_error == {stage: f"{said}: ValueError: one odd frame"}
    assert result.fusion.frame_count == 4
    assert 0 < result.keyframes <= expected.keyframes


def test_the_last_update_of_the_objects_may_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, _ = run((0, 33))
    assert expected.complete
    failing(monkeypatch, Fusion, "objects", 2)
    result, steps = run((0, 33))
    assert [step.objects for step in steps] == [None, None]
    assert not result.complete
    assert result.failures.last_error == {"fusion": "no objects after 2 frames: ValueError: one odd frame"}


def test_frames_of_a_time_that_no_message_holds_are_skipped() -> None:
    result, steps = run((-20, 0, 33, 10**16))
    assert result.skipped == {"cannot be sent": 2}
    assert result.unreadable == f"the frame at {10**22} ns cannot be sent: its timestamp is out of range"
    assert [step.frame.stamp_ns for step in steps] == [0, 33 * MS]


def test_a_frame_with_a_pose_that_no_camera_can_have_is_not_fused() -> None:
    stamps = (0, 33, 66, 100, 133, 166)
    result, steps = run(stamps, (0.0, 0.0, 5.0, 3000.0, 0.6, 0.0))
    assert result.skipped == {"implausible pose": 1, "pose too far from the origin": 1}
    refused = ["", "", "implausible pose", "pose too far from the origin", "", ""]
    assert [step.refused for step in steps] == refused
    assert result.keyframes == sum(step.segments is not None for step in steps if not step.refused)
    assert result.fusion.frame_count == 4
    assert len(result.trajectory) == 6, "what was said of them is told"
    assert np.abs(result.fusion.heatmap.points()[:, 0]).max() < 4.0


def test_what_was_taken_away_is_no_object_in_the_end() -> None:
    """Nor is there one where a thing stood before it was moved; where it stands then, and what was put down, are."""
    scene = Scene(1, "changing", 270, Intrinsics(292.5, 292.5, 160.0, 120.0, 320, 240))
    given = load_settings(overrides={"pose": {"provider": "given"}})
    result = run_pipeline(Selected(scene, range(0, 270, 10)), given)
    found = [item.box for item in result.objects.objects]
    now = [box.centre.tolist() for box in scene.boxes]
    former = [box for box in build_scene(1, "changing").boxes if box.centre.tolist() not in now]
    assert len(former) == 2
    assert len(found) == len(now) == 12
    assert overlaps(scene.boxes, found).min() > 0.5
    assert overlaps(former, found).max() == 0


def overlaps(true: Sequence[TrueBox], found: list[Box3D]) -> NDArray[np.float64]:
    """The greatest IoU (n,) of each true box with any found one."""
    return np.asarray(iou_matrix_3d(true, found).max(axis=1))
