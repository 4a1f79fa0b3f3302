import json

import numpy as np
import pytest

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.run.lost_tracking import LostTracking, notice
from spot3d.run.report import FrameRate, HopTimes, RunReport, StageReport, report_document, statistics_ms
from spot3d.run.results import MapSnapshot, RunResult, TrackedFrame, found_in, write_json, write_ply, write_results
from spot3d_schemas import Hop

TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
FOUND = FoundObject(7, Box3D(np.array([1, 2, 3.5]), np.array([0.1, 0.2, 0.3]), TURN), 0.5, 12, 345)


def snapshot(count: int) -> MapSnapshot:
    rng = np.random.default_rng(count)
    return MapSnapshot(
        rng.normal(size=(count, 3)).astype(np.float32),
        rng.integers(0, 256, (count, 3)).astype(np.uint8),
        rng.random(count).astype(np.float32),
        rng.integers(0, 1000, count).astype(np.uint32),
        3 * count,
    )


def poses(lost: tuple[bool, ...]) -> tuple[TrackedFrame, ...]:
    result = []
    for index, is_lost in enumerate(lost):
        pose = np.eye(4)
        pose[0, 3] = index
        result.append(TrackedFrame(index * 33_333_333, pose, is_lost))
    return tuple(result)


@pytest.mark.parametrize("objects", [(), (FOUND,)])
def test_results_can_be_read_back(objects, tmp_path):
    result = RunResult(objects, (0.0, 0.6, 0.8), 3, poses((False, True, False)), snapshot(len(objects)))
    write_results(tmp_path, result)
    document = json.loads((tmp_path / "objects.json").read_text())
    assert set(document) == {"objects", "up", "frame_count"}
    assert document["up"] == [0.0, 0.6, 0.8]
    assert document["frame_count"] == 3
    for item in document["objects"]:
        assert set(item) == {"id", "centre", "size", "rotation", "points", "confidence", "views"}
        assert item["rotation"] == TURN.tolist(), "rows; the columns are the box's axes"
    read = found_in(document).objects
    assert [(item.id, item.views, item.points, item.confidence) for item in read] == [
        (item.id, item.views, item.points, item.confidence) for item in objects
    ]
    assert not list(tmp_path.glob(".*")), "nothing half written is left"


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_ply_is_what_its_header_says(count, tmp_path):
    points = snapshot(count)
    write_ply(tmp_path / "map.ply", points)
    header, _, body = (tmp_path / "map.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert f"element vertex {count}" in lines
    kinds = {"float": "<f4", "uchar": "u1", "uint": "<u4"}
    fields = [line.split()[1:] for line in lines if line.startswith("property")]
    assert [name for _, name in fields] == ["x", "y", "z", "red", "green", "blue", "heat", "frequency"]
    rows = np.frombuffer(body, np.dtype([(name, kinds[kind]) for kind, name in fields]))
    assert len(rows) == count
    np.testing.assert_array_equal(np.column_stack([rows[axis] for axis in "xyz"]).reshape(-1, 3), points.xyz)
    np.testing.assert_array_equal(rows["green"], points.rgb[:, 1])
    np.testing.assert_array_equal(rows["frequency"], points.frequency)


def test_a_failed_write_leaves_the_old_file(tmp_path):
    write_json(tmp_path / "report.json", {"frames": 1})
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "report.json", {"frames": float("nan")})
    assert json.loads((tmp_path / "report.json").read_text()) == {"frames": 1}


def test_report_document():
    report = RunReport("scene", "processes", 10, (320, 240), fused=8, skipped={"lost pose": 2}, wall_s=4.0)
    report.stages = {"pose": StageReport({"p50": 1.23456, "p99": None}, 1.0, 100.0, restarts=1)}
    report.drops = {"pose": {"out of order": 1}, "fusion": {}}
    document = json.loads(json.dumps(report_document(report, RunResult()), allow_nan=False))
    assert document["keyframes"] == 0
    assert document["frames"] == {"input": 10, "fused": 8, "skipped": {"lost pose": 2}, "lost_poses": 0, "lost": []}
    assert document["drops"] == {"pose": {"out of order": 1}}
    assert document["restarts"] == {"pose": 1}
    assert document["stages"]["pose"]["step_ms"] == {"p50": 1.235, "p99": None}
    assert document["version"]
    assert document["machine"]["cores"] >= 1


def test_hop_times():
    times = HopTimes()
    assert times.statistics() == {}
    source = Hop(stage="source", received_ns=0, sent_ns=1_000_000)
    times.add((source, Hop(stage="pose", received_ns=3_000_000, sent_ns=9_000_000)), whole="all")
    times.add((source,), whole="all")
    assert times.statistics() == {
        "source to pose": {"p50": 2.0, "p99": 2.0, "mean": 2.0},
        "all": {"p50": 8.0, "p99": 8.0, "mean": 8.0},
    }
    for number in range(100):
        times.add((source, Hop(stage=f"made-up-{number}", received_ns=2_000_000, sent_ns=2_000_000)))
    assert len(times.statistics()) == 16, "whatever is sent"
    assert statistics_ms([]) == {}


def test_frame_rate_counts_from_the_first_frame():
    rate = FrameRate()
    assert rate.ms_per_frame() is None
    rate.add(1, 10.0)
    assert rate.ms_per_frame() is None
    rate.add(5, 10.4)
    rate.add(5, 99.0)
    assert rate.ms_per_frame() == pytest.approx(100)


def test_stretches_of_lost_tracking_are_told():
    lost = [index in (1, *range(20, 35)) or index >= 80 for index in range(100)]
    tracking = LostTracking()
    for index, is_lost in enumerate(lost):
        tracking.add(10 * index, is_lost)
    found = tracking.stretches()
    assert tracking.frames == sum(lost)
    assert [(item.from_ns, item.to_ns, item.frames) for item in found] == [(10, 10, 1), (200, 340, 15), (800, 990, 20)]
    text = notice(found)
    assert text.startswith("tracking was lost in 35 frames, in 2 stretches, the last 20 of them to the end")
    assert notice(found[:1]) == notice([]) == ""
    tracking.add(1000, False)
    assert not tracking.stretches()[-1].to_the_end


def test_many_short_stretches_are_told_as_well():
    """Such as frames between given poses that are too far apart."""
    tracking = LostTracking()
    for index in range(30):
        tracking.add(index, index % 3 != 0, "the frame has no given pose")
    assert (
        notice(tracking.stretches()) == "tracking was lost in 20 frames, in 10 stretches (the frame has no given pose)"
    )


def test_given_poses_that_end_need_no_camera_that_returns():
    tracking = LostTracking()
    for index in range(40):
        tracking.add(index, index >= 10, "the frame has no given pose")
    found = tracking.stretches()
    told, reason = "tracking was lost in 30 frames, the last 30 of them to the end", "(the frame has no given pose)"
    assert notice(found) == f"{told}: the camera did not return to a place that it saw before {reason}"
    assert notice(found, given_poses=True) == f"{told} {reason}"


def test_why_tracking_was_lost_is_told_and_reported():
    tracking = LostTracking()
    for index in range(40):
        tracking.add(index, index >= 10, "an implausible motion of 2 m" if index < 12 else "the depth image is empty")
    assert notice(tracking.stretches()).endswith("(the depth image is empty)")
    report = RunReport("desk", "processes", 40, (640, 480), lost=tracking.stretches())
    lost = report_document(report, RunResult())["frames"]["lost"]
    assert [item["reason"] for item in lost] == ["the depth image is empty"]


@pytest.mark.parametrize("count", [5, 40])
def test_who_was_never_followed_had_nowhere_to_move_back_to(count):
    tracking = LostTracking()
    for index in range(count):
        tracking.add(index, True, "the depth image is empty")
    assert notice(tracking.stretches()) == f"none of the {count} frames could be tracked (the depth image is empty)"


def test_of_very_many_stretches_the_longest_are_kept():
    tracking = LostTracking()
    for index in range(3000):
        tracking.add(index, index % 10 == 0 or 1500 <= index < 1520)
    found = tracking.stretches()
    assert len(found) == 100
    assert max(item.frames for item in found) == 21
    assert tracking.frames == 300 + 18
