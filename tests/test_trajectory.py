"""Trajectory files and errors, against values worked out by hand."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from spot3d.trajectory import (
    align,
    ate,
    quaternion_from_rotation,
    read_tum,
    rotation_angle,
    rotation_from_quaternion,
    rpe,
    write_tum,
)


def turn_z(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def poses(*positions: tuple[float, float, float]) -> NDArray[np.float64]:
    result = np.tile(np.eye(4), (len(positions), 1, 1))
    result[:, :3, 3] = positions
    return result


@pytest.mark.parametrize(
    ("rotation", "quaternion"),
    [
        (np.eye(3), (0, 0, 0, 1)),
        (turn_z(np.pi / 2), (0, 0, np.sqrt(0.5), np.sqrt(0.5))),
        (np.diag([1.0, -1.0, -1.0]), (1, 0, 0, 0)),
        (np.diag([-1.0, 1.0, -1.0]), (0, 1, 0, 0)),
    ],
)
def test_quaternions_by_hand(rotation: NDArray[np.float64], quaternion: tuple[float, ...]) -> None:
    found = quaternion_from_rotation(rotation)
    assert np.allclose(found, quaternion) or np.allclose(-found, quaternion)
    assert np.allclose(rotation_from_quaternion(np.array(quaternion, np.float64)), rotation)


def test_a_quaternion_of_length_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="length zero"):
        rotation_from_quaternion(np.zeros(4))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.0, 3.0, np.pi])
def test_rotation_angle(angle: float) -> None:
    assert rotation_angle(turn_z(angle)) == pytest.approx(angle, abs=1e-12)


@pytest.mark.parametrize("count", [0, 1, 20])
def test_tum_round_trip(tmp_path: Path, count: int) -> None:
    random = np.random.default_rng(count)
    # Seconds since 1970 with nanoseconds: more digits than a float holds.
    stamps = [1_700_000_000_123_456_789 + 33_333_333 * i for i in range(count)]
    written = np.tile(np.eye(4), (count, 1, 1))
    for pose in written:
        pose[:3, :3] = rotation_from_quaternion(random.normal(size=4))
        pose[:3, 3] = random.normal(size=3)
    path = tmp_path / "trajectory.txt"
    write_tum(path, stamps, written)
    read_stamps, read = read_tum(path)
    assert read_stamps == stamps
    assert read.shape == (count, 4, 4)
    np.testing.assert_allclose(read, written, atol=5e-9)


def test_tum_format_to_the_letter(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    write_tum(path, [1_500_000_001], poses((1, -2, 0.5)))
    fields = path.read_text().split()
    assert fields[0] == "1.500000001"
    assert [float(field) for field in fields[1:]] == [1, -2, 0.5, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# stamp\n\n1 0 0 0 0 0 0", "line 3: expected 8 numbers, got 7"),
        ("1 0 0 0 0 0 0 0", "line 1: a quaternion of length zero"),
        ("1 0 0 x 0 0 0 1", "line 1: could not convert"),
        ("1 0 0 nan 0 0 0 1", "line 1: not all numbers are finite"),
        ("now 0 0 0 0 0 0 1", "line 1"),
    ],
)
def test_a_broken_line_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "broken.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_tum(path)


def test_errors_by_hand() -> None:
    true = poses((0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0))
    estimated = poses((0, 0, 0), (1, 0, 0), (2, 0.3, 0), (3, 0.3, 0.4))
    # Positions are off by 0, 0, 0.3 and 0.5; the steps by 0, 0.3 and 0.4.
    absolute = ate(true, estimated, align_first=False)
    assert absolute == pytest.approx({"rmse": np.sqrt((0.09 + 0.25) / 4), "mean": 0.2, "median": 0.15})
    translation, rotation = rpe(true, estimated)
    assert translation == pytest.approx({"rmse": np.sqrt(0.25 / 3), "mean": 0.7 / 3, "median": 0.3})
    assert rotation == pytest.approx({"rmse": 0, "mean": 0, "median": 0})


def test_rotation_error_by_hand() -> None:
    true, estimated = poses((0, 0, 0), (0, 0, 0), (0, 0, 0)), poses((0, 0, 0), (0, 0, 0), (0, 0, 0))
    estimated[1, :3, :3] = turn_z(0.1)
    estimated[2, :3, :3] = turn_z(0.4)
    _, rotation = rpe(true, estimated)
    assert rotation == pytest.approx({"rmse": np.sqrt((0.01 + 0.09) / 2), "mean": 0.2, "median": 0.2})


def test_alignment_removes_a_rigid_motion_and_nothing_else() -> None:
    random = np.random.default_rng(1)
    true = poses(*random.normal(size=(10, 3)))
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn_z(0.7), (1, 2, 3)
    assert ate(true, motion @ true, align_first=False)["rmse"] > 1
    assert ate(true, motion @ true)["rmse"] < 1e-12
    np.testing.assert_allclose(align(true, motion @ true), np.linalg.inv(motion), atol=1e-12)
    scaled = true.copy()
    scaled[:, :3, 3] *= 1.1
    assert ate(true, scaled)["rmse"] > 0.05


@pytest.mark.parametrize(("lengths", "message"), [((0, 0), "at least"), ((1, 1), "at least"), ((3, 2), "two")])
def test_trajectories_that_cannot_be_compared(lengths: tuple[int, int], message: str) -> None:
    a, b = (np.tile(np.eye(4), (length, 1, 1)) for length in lengths)
    with pytest.raises(ValueError, match=message):
        rpe(a, b)


def test_bytes_that_are_no_text_are_named(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_bytes(b"\xff\xfe1.5 0 0")
    with pytest.raises(ValueError, match=r"poses\.txt is not UTF-8 text"):
        read_tum(path)
    path.write_bytes(b"\xef\xbb\xbf# stamp tx ty tz qx qy qz qw\n1.5 0 0 0 0 0 0 1\n")
    assert read_tum(path)[0] == [1_500_000_000]
