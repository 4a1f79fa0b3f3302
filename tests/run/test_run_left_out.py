"""The line that says why a run found nothing, or almost nothing, and what the report says of it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from spot3d.boxes import Box3D
from spot3d.camera import Intrinsics
from spot3d.found_object import FoundObject
from spot3d.frame_segments import KEYFRAME_REASONS
from spot3d.fusion.objects.reasons import REASONS
from spot3d.run.left_out import first_depth, forgotten, pose_doubt, why_so_few
from spot3d.run.report import RunReport, report_document
from spot3d.run.results import RunResult
from spot3d.settings import load_settings
from spot3d.source.recording import RecordedFrame, Recording
from spot3d.source.selected import Selected
from spot3d.source.sequence import FrameList

FOUND = FoundObject(1, Box3D(np.zeros(3), np.full(3, 0.1), np.eye(3)), 0.5, 12, 345)


def result(found: int, left_out: dict[str, int], frames: int = 30) -> RunResult:
    return RunResult(objects=(FOUND,) * found, frame_count=frames, left_out=left_out)


@pytest.mark.parametrize(
    ("found", "left_out", "said"),
    [
        (
            0,
            {"seen too seldom": 4, "too cold": 2, "too large": 3},
            "no objects: 3 candidates were longer than 1 m (eps_max), 2 colder than 0.15 (eps), 4 seen in fewer than 3 "
            "keyframes; if these are objects, raise size_max",
        ),
        (
            0,
            {"seen too seldom": 1},
            "no objects: 1 candidate was seen in fewer than 3 keyframes; move the camera slowly around the "
            "objects, or record for longer",
        ),
        (
            1,
            {"too small": 3, "too thin": 1, "seen too seldom": 99},
            "only 1 of 5 candidates is an object: 3 were smaller than 2 cm (eps_min) or 1 cm3, 1 thinner than 5 mm "
            "(eps_p); if these are objects, move the camera nearer, or lower size_min",
        ),
        (
            2,
            {"background in most views": 7},
            "only 2 of 9 candidates are objects: 7 were background in most views; other views see a table or a wall "
            "there: check that the poses fit the depth",
        ),
        (0, {"a newer reason": 1}, "no objects: 1 candidate was a newer reason"),
    ],
)
def test_hardly_any_object_is_explained(found: int, left_out: dict[str, int], said: str) -> None:
    assert why_so_few(result(found, left_out), 12, load_settings()) == said


@pytest.mark.parametrize(
    ("found", "left_out"),
    [
        (1, {}),
        (1, {"too cold": 3}),
        (1, {"seen too seldom": 500}),
        (20, {"too cold": 32, "background in most views": 9}),
    ],
)
def test_all_is_well_without_a_word(found: int, left_out: dict[str, int]) -> None:
    assert why_so_few(result(found, left_out), 12, load_settings()) == ""


def test_every_reason_has_words_of_its_own() -> None:
    for reason in REASONS:
        said = why_so_few(result(0, {reason: 2}), 12, load_settings())
        assert said.startswith("no objects: 2 candidates were "), reason
        assert "; " in said, reason


@pytest.mark.parametrize(
    ("preset", "keyframes", "said"),
    [
        (None, 12, "no candidates in 12 keyframes: an object must rise 1 cm above a visible surface"),
        (None, 0, "fusion received no segments of keyframes"),
        (
            "paper",
            0,
            "nothing on a supporting plane was seen often enough (fusion.frequency_min 5), hot "
            "(fusion.heat_min 0.25) and dense enough (fusion.density_points 50)",
        ),
    ],
)
def test_where_nothing_was_so_much_as_a_candidate(preset: str | None, keyframes: int, said: str) -> None:
    assert why_so_few(result(0, {}), keyframes, load_settings(preset=preset)).startswith(f"no objects: {said}")


def test_what_the_paper_s_way_found_too_small_is_told_by_its_own_rule() -> None:
    said = why_so_few(result(0, {"too small": 2}), 0, load_settings(preset="paper"))
    assert said == ("no objects: 2 candidates were smaller than 1 cm3; if these are objects, lower fusion.volume_min")


def test_parts_of_keyframes_are_told_where_nothing_else_is() -> None:
    parts = {name: count for count, name in enumerate(KEYFRAME_REASONS, start=1)}
    assert why_so_few(result(0, parts), 12, load_settings()).endswith(
        "; left out of keyframes: 1 too small, 2 too low, 3 too long, 4 too cold, 5 too many, 6 below the support, "
        "7 without a support, 8 without depth, 9 several objects in one, 10 for another reason"
    )
    assert why_so_few(result(1, parts), 12, load_settings()) == ""


def test_frames_that_were_not_fused_are_told_elsewhere() -> None:
    assert why_so_few(result(0, {}, frames=0), 0, load_settings()) == ""


@pytest.mark.parametrize(
    ("found", "left_out", "fused", "skipped"),
    [
        (0, {"seen too seldom": 42, "too small in a keyframe": 139}, 30, {}),
        (0, {"background in most views": 3}, 30, {}),
        (0, {"no longer there": 3}, 30, {}),
        (8, {}, 1, {"implausible pose": 29}),
        (0, {}, 0, {"pose too far from the origin": 30}),
        (8, {}, 9, {"implausible pose": 5, "pose too far from the origin": 5}),
    ],
)
def test_where_poses_hardly_are_what_they_have_to_be_it_is_said_what_that_is(
    found: int, left_out: dict[str, int], fused: int, skipped: dict[str, int]
) -> None:
    assert pose_doubt(result(found, left_out, fused), fused, skipped) == (
        "are the given poses camera-to-world, in metres, of a camera with x right, y down, z forward? "
        "Compare with --pose kiss, which does not use them"
    )


@pytest.mark.parametrize(("jumps", "times"), [(1, "once"), (12, "12 times")])
def test_poses_that_jump_away_from_the_map_are_doubted_whatever_is_found(jumps: int, times: str) -> None:
    assert pose_doubt(result(25, {}), 30, {}, jumps).startswith(
        f"the given poses jumped {times} away from what depth shows, and objects may be found twice: are the given "
        "poses camera-to-world, "
    )


@pytest.mark.parametrize(
    ("found", "left_out", "fused", "skipped"),
    [
        (0, {}, 0, {}),
        (0, {"too large": 3, "seen too seldom": 0}, 30, {}),
        (1, {"seen too seldom": 42, "no longer there": 3}, 30, {}),
        (8, {}, 20, {"implausible pose": 10, "lost pose": 30}),
    ],
)
def test_poses_without_a_sign_of_a_fault_are_not_doubted(
    found: int, left_out: dict[str, int], fused: int, skipped: dict[str, int]
) -> None:
    assert pose_doubt(result(found, left_out, fused), fused, skipped) == ""


def test_forgotten_keyframes_are_told() -> None:
    assert forgotten(0, load_settings()) == ""
    assert forgotten(20, load_settings()) == (
        "the first 20 keyframes were forgotten, with objects that only they show: fusion keeps 200; "
        "raise fusion.keyframe_limit"
    )


def test_the_report_counts_them_by_reason() -> None:
    found = replace(result(2, {"too cold": 3}), keyframes_dropped=20, map_limit_reached=True)
    document = report_document(RunReport("scene", "processes", 10, (320, 240)), found)
    assert document["objects"] == {"found": 2, "left_out": {"too cold": 3}}
    assert document["keyframes_dropped"] == 20
    assert document["map_limit_reached"] is True


def test_the_first_frame_s_depth_shows_a_wrong_unit(tmp_path: Path) -> None:
    camera = Intrinsics(20.0, 20.0, 2.0, 1.0, 4, 2)
    paths = tmp_path / "colour.png", tmp_path / "depth.png"
    assert cv2.imwrite(str(paths[0]), np.zeros((2, 4, 3), np.uint8))
    assert cv2.imwrite(str(paths[1]), np.array([[0, 0, 0, 6000], [6000, 6100, 6200, 9000]], np.uint16))
    recording = Recording([RecordedFrame(0, *paths, None)], camera, 0.001)
    assert first_depth(recording) == (
        "the median depth of the first frame is 6.10 m, read as units of 1 mm; if that is wrong, set the unit of a "
        "folder with --depth-unit METRES"
    )
    assert first_depth(Selected(recording, range(1))) == first_depth(recording)
    assert [bool(first_depth(replace(recording, depth_scale=unit), found=True)) for unit in (1e-3, 2e-4, 5e-5)] == [
        True,
        False,
        True,
    ], "units that make a kitchen a hall, or a doll's house"
    assert not first_depth(FrameList([recording[0]])), "other inputs take no --depth-unit"
    paths[1].unlink()
    assert not first_depth(recording)
