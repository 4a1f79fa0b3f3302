"""A map that outlives its process: the next one goes on from it, or refuses it whole."""

from pathlib import Path

import numpy as np
import pytest
from fusion_room import CAMERA, COARSE, ROOM, THREE, orbit, view
from voting_room import keyframe

from spot3d.boxes import iou_matrix_3d
from spot3d.camera_pose import CameraPose
from spot3d.dataflow.snapshot_file import SnapshotError, snapshot_bytes, write_snapshot
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.snapshot import Account, fusion_snapshot, keep, read_account, resume
from spot3d.fusion.snapshot_keeper import resumed

FRAMES = 12
T_WORLD_MAP = np.eye(4)
T_WORLD_MAP[:3, 3] = (0.01, -0.02, 0.0)


def fuse(fusion: Fusion, frames: range) -> Fusion:
    """Fuse frames of an arc, each a keyframe with perfect labels, and find the objects after the last."""
    for stamp, pose in list(enumerate(orbit(FRAMES)))[frames.start : frames.stop]:
        seen = view(pose, ROOM + THREE, np.random.default_rng(stamp))
        fusion.fuse(seen.colour, seen.depth, seen.heat, CAMERA, CameraPose(T_WORLD_MAP @ pose, T_WORLD_MAP), stamp)
        true = keyframe(pose, THREE)
        assert fusion.observe(FrameSegments(true.labels, true.heat, true.planes, true.stands_on, CAMERA), stamp)
    return fusion


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The snapshot of a fusion of half the frames."""
    fusion = fuse(Fusion(COARSE), range(6))
    kept = keep(fusion, Account("a stream", "an epoch", "a world", 5, 6, {"lost pose": 1}, 6, 7))
    task = fusion.snapshot()
    fuse(fusion, range(6, 7))  # what comes while the objects are found is not in it
    task()
    path = tmp_path_factory.mktemp("state") / "fusion.snapshot"
    write_snapshot(path, snapshot_bytes(fusion_snapshot(kept)))
    return path


def test_another_process_goes_on_with_the_same_map_and_the_same_numbers(file: Path) -> None:
    told, kept = read_account(file)
    assert (told.stream, told.epoch, told.world, told.fused_ns) == ("a stream", "an epoch", "a world", 5)
    assert (told.fused, told.skipped, told.last_stamp_ns, told.in_stream) == (6, {"lost pose": 1}, 6, 7)
    fusion = Fusion(COARSE)
    resume(fusion, kept, file)
    alone = fuse(Fusion(COARSE), range(6))
    before, expected = fusion.objects(), alone.objects()
    assert before.frame_count == 6
    assert [item.id for item in before.objects] == [item.id for item in expected.objects] == [1, 2, 3]
    for ours, theirs in zip(before.objects, expected.objects, strict=True):
        np.testing.assert_array_equal(ours.box.centre, theirs.box.centre)
    np.testing.assert_array_equal(fusion.frequent_points().xyz, alone.frequent_points().xyz)
    count = fusion.heatmap.count
    after = fuse(fusion, range(6, FRAMES)).objects()
    assert [item.id for item in after.objects] == [1, 2, 3]
    iou = iou_matrix_3d([item.box for item in before.objects], [item.box for item in after.objects])
    assert (iou.diagonal() > 0.7).all(), "each number is still the same object's"
    # The surface that was known found its points again.
    assert fusion.heatmap.count < 1.25 * fuse(alone, range(6, FRAMES)).heatmap.count
    assert fusion.heatmap.count > count


def test_who_resumes_from_a_file_is_told_which_poses_go_with_it(file: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    resumed(Fusion(COARSE), file)
    assert f"resumes from {file}: 6 frames; poses must be in the same world (pose.provider given)" in caplog.text


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda data: data[: len(data) // 2], "damaged"),
        (lambda data: data[:100] + bytes([data[100] ^ 1]) + data[101:], "damaged"),
        (lambda data: data[:-1], "damaged"),
        (lambda _data: b"", "not a snapshot"),
        (lambda _data: b"PK\x03\x04 another program's", "not a snapshot"),
        (lambda data: data[:18], "damaged"),
    ],
)
def test_a_damaged_or_foreign_file_is_refused(file: Path, tmp_path: Path, spoil, why: str) -> None:
    spoilt = tmp_path / "spoilt.snapshot"
    spoilt.write_bytes(spoil(file.read_bytes()))
    with pytest.raises(SnapshotError, match=f"spoilt.snapshot.*{why}"):
        read_account(spoilt)


def test_a_map_of_other_settings_is_refused_whole(file: Path) -> None:
    kept = read_account(file)[1]
    for other, why in (({"voxel": 0.02}, "voxel"), ({"map_limit": 1000}, "map_limit")):
        fusion = Fusion(COARSE.model_copy(update=other))
        with pytest.raises(SnapshotError, match=why):
            resume(fusion, kept, file)
        assert (fusion.frame_count, fusion.heatmap.count, fusion.objects().objects) == (0, 0, [])


def test_a_map_of_another_version_is_refused_whole(file: Path) -> None:
    """One whose segments lack what this version knows of each, however deep in it."""
    kept = read_account(file)[1]
    segments = kept.values["consensus"]["fields"]["_graph"]["fields"]["segments"]
    assert segments["object"] == "SegmentTable"
    del segments["fields"]["support"]
    fusion = Fusion(COARSE)
    with pytest.raises(SnapshotError, match="another version"):
        resume(fusion, kept, file)
    assert (fusion.frame_count, fusion.heatmap.count, fusion.objects().objects) == (0, 0, [])
