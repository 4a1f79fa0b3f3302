"""Files that grow keep whole lines only, up to their limit, and count what they lack."""

import json
from pathlib import Path

import numpy as np

from spot3d.boxes import Box3D
from spot3d.found_object import FoundObject
from spot3d.run.growing_files import GrowingFiles
from spot3d.run.results import RunResult, found_in
from spot3d.trajectory import read_tum

FOUND = RunResult(
    objects=(FoundObject(3, Box3D(np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.1, 0.2]), np.eye(3)), 0.5, 4, 100),),
    up=(0.0, 0.0, 1.0),
    frame_count=7,
)


def test_lines_come_back_and_the_limit_is_told(tmp_path: Path) -> None:
    path = tmp_path / "objects.jsonl"
    with GrowingFiles(tmp_path) as files:
        files.add_update(5, FOUND, complete=False)
        files.add_update(6, FOUND, complete=True)
        assert files.notices() == []
    whole = path.read_bytes()
    documents = [json.loads(line) for line in whole.splitlines()]
    assert [(item["stamp_ns"], item["complete"]) for item in documents] == [(5, False), (6, True)]
    back = found_in(documents[0])
    assert (back.up, back.frame_count, back.objects[0].id) == (FOUND.up, 7, 3)
    assert (back.objects[0].box.centre == FOUND.objects[0].box.centre).all()

    with GrowingFiles(tmp_path, limit_bytes=len(whole) - 1) as files:
        for stamp_ns in (5, 6, 7):
            files.add_update(stamp_ns, FOUND, complete=False)
        assert files.notices() == [
            f"objects.jsonl has reached its limit of {len(whole) - 1} bytes; 2 updates are missing"
        ]
    assert len(path.read_text().splitlines()) == 1


def test_a_full_disk_ends_nothing(tmp_path: Path) -> None:
    """Nor does one that not even takes back half a line, as a disk that is unplugged."""
    (tmp_path / "trajectory.txt").symlink_to("/dev/full")
    with GrowingFiles(tmp_path) as files:
        for stamp_ns in (5, 6):
            files.add_pose(stamp_ns, np.eye(4))
        assert files.notices() == ["trajectory.txt cannot be written: No space left on device; 2 poses are missing"]


def test_a_trajectory_is_written_as_it_goes_and_its_limit_is_told(tmp_path: Path) -> None:
    place, pose = tmp_path / "trajectory.txt", np.eye(4)
    with GrowingFiles(tmp_path, limit_bytes=300) as files:
        for index in range(3):
            pose[0, 3] = index
            files.add_pose(index * 33_333_333, pose)
            files.add_pose(index * 33_333_333, pose)
        stamps, path = read_tum(place)
        assert stamps == [0, 33_333_333, 66_666_666], "each once"
        np.testing.assert_allclose(path[2, :3, 3], (2, 0, 0))
        assert files.notices() == []
        files.add_pose(10**9, np.eye(4))
        assert files.notices() == ["trajectory.txt has reached its limit of 300 bytes; 1 poses are missing"]
    assert read_tum(place)[0] == stamps
