"""Camera trajectories: TUM files, and the errors ATE and RPE by evo's definitions."""

import math
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spot3d.whole_file import whole_file


def rotation_angle(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle in radians, [0, pi], of each of (..., 3, 3) rotation matrices.

    By atan2 of sine and cosine, which stays exact for the tiny angles between neighbouring frames.
    """
    axis = rotation[..., (2, 0, 1), (1, 2, 0)] - rotation[..., (1, 2, 0), (2, 0, 1)]
    trace = np.trace(rotation, axis1=-2, axis2=-1)
    return np.asarray(np.arctan2(np.linalg.norm(axis, axis=-1), trace - 1))


def quaternion_from_rotation(rotation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit quaternion (x, y, z, w), w >= 0, of a (3, 3) rotation matrix (Bar-Itzhack 2000).

    The eigenvector of the largest eigenvalue is the nearest rotation, also for a matrix that is slightly off.
    """
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    quaternion: NDArray[np.float64] = np.linalg.eigh(k)[1][:, 3]
    return -quaternion if quaternion[3] < 0 else quaternion


def rotation_from_quaternion(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation matrix of a quaternion (x, y, z, w) of any length but zero (ValueError)."""
    norm = float(np.linalg.norm(quaternion))
    if not norm > 0:
        raise ValueError("a quaternion of length zero is not a rotation")
    x, y, z, w = quaternion / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def pose_from_quaternion(position: ArrayLike, quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) pose of a position (3,) and a quaternion (x, y, z, w) of any length but zero (ValueError)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_from_quaternion(quaternion)
    pose[:3, 3] = position
    return pose


def rotation_from_vector(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation of a rotation vector, radians (Rodrigues)."""
    angle = math.sqrt(float(vector @ vector))
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine = math.sin(angle) / angle if angle > 0 else 1.0
    versine = 0.5 * (2 * math.sin(angle / 2) / angle) ** 2 if angle > 0 else 0.5
    return np.asarray(np.eye(3) + sine * skew + versine * (skew @ skew))


def nearest_rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The rotation nearest to a (3, 3) matrix by least squares (Umeyama 1991), such as to a mean of rotations."""
    u, _, vt = np.linalg.svd(matrix)
    if np.linalg.det(u @ vt) < 0:
        u[:, 2] *= -1  # the nearest orthogonal matrix is a reflection
    return np.asarray(u @ vt)


def rotation_to_z(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """The (3, 3) rotation of least angle that turns the unit vector `up`, float64, to (0, 0, 1) (Rodrigues)."""
    x, y, c = up[0], up[1], up[2]
    if c < -1 + 1e-9:
        return np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    a, b, d = x * x / (1 + c), y * y / (1 + c), x * y / (1 + c)
    return np.array([[1 - a, -d, -x], [-d, 1 - b, -y], [x, y, 1 - a - b]])


def write_tum(path: Path, stamps_ns: Sequence[int], T_world_camera: NDArray[np.float64]) -> None:
    """Write a trajectory in TUM format: `stamp tx ty tz qx qy qz qw`, seconds with nine decimals, metres.

    stamps_ns: n integer nanoseconds; T_world_camera: (n, 4, 4). Stamps come back exactly from `read_tum`.
    """
    lines = [tum_line(stamp, pose) for stamp, pose in zip(stamps_ns, T_world_camera, strict=True)]
    with whole_file(path) as stream:
        stream.write("".join(line + "\n" for line in lines).encode())


def tum_line(stamp_ns: int, T_world_camera: NDArray[np.float64]) -> str:
    """One pose, (4, 4), as a line of a TUM file."""
    numbers = (*T_world_camera[:3, 3], *quaternion_from_rotation(T_world_camera[:3, :3]))
    return f"{Decimal(int(stamp_ns)).scaleb(-9):.9f} " + " ".join(f"{number:.9f}" for number in numbers)


def read_tum(path: Path) -> tuple[list[int], NDArray[np.float64]]:
    """Read a TUM trajectory: n stamps in nanoseconds, (n, 4, 4) float64 T_world_camera.

    Empty lines and lines that begin with # are skipped. ValueError names the file and the line at fault.
    """
    stamps: list[int] = []
    poses: list[NDArray[np.float64]] = []
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not UTF-8 text: {error}") from error
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            if len(fields) != 8:
                raise ValueError(f"expected 8 numbers, got {len(fields)}")
            values = np.array([float(field) for field in fields[1:]])
            if not np.isfinite(values).all():
                raise ValueError("not all numbers are finite")
            # Decimal keeps the nanoseconds that a float of seconds since 1970 would lose.
            stamps.append(int(Decimal(fields[0]).scaleb(9).to_integral_value()))
            poses.append(pose_from_quaternion(values[:3], values[3:]))
        except (ValueError, ArithmeticError) as error:
            raise ValueError(f"{path}, line {number}: {error}") from error
    return stamps, np.array(poses).reshape(-1, 4, 4)


def align(true: NDArray[np.float64], estimated: NDArray[np.float64]) -> NDArray[np.float64]:
    """T_true_estimated (4, 4) that best maps the estimated positions onto the true ones, without scale.

    true, estimated: (n, 4, 4) poses. Umeyama 1991; least squares over the positions.
    """
    p, q = true[:, :3, 3], estimated[:, :3, 3]
    transform = np.eye(4)
    transform[:3, :3] = nearest_rotation((p - p.mean(0)).T @ (q - q.mean(0)))
    transform[:3, 3] = p.mean(0) - transform[:3, :3] @ q.mean(0)
    return transform


def ate(true: NDArray[np.float64], estimated: NDArray[np.float64], align_first: bool = True) -> dict[str, float]:
    """Absolute trajectory error: rmse, mean and median distance of the positions, metres (evo's `evo_ape`).

    true, estimated: (n, 4, 4) T_world_camera of the same stamps; `align_first` moves the estimate onto the
    truth by the best rigid transform. ValueError where the lengths differ or there is no pose.
    """
    _check_pair(true, estimated, least=1)
    if align_first:
        estimated = align(true, estimated) @ estimated
    return _statistics(np.linalg.norm(true[:, :3, 3] - estimated[:, :3, 3], axis=1))


def rpe(true: NDArray[np.float64], estimated: NDArray[np.float64]) -> tuple[dict[str, float], dict[str, float]]:
    """Relative pose error from frame to frame: statistics of translation (metres) and rotation (radians).

    true, estimated: (n, 4, 4) T_world_camera of the same stamps. For each pair (i, i + 1) the error is
    (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), all pairs as in `evo_rpe --all_pairs`. Each result holds rmse, mean, median.
    ValueError where the lengths differ or there are less than two poses.
    """
    _check_pair(true, estimated, least=2)
    true_motion = np.linalg.inv(true[:-1]) @ true[1:]
    motion = np.linalg.inv(estimated[:-1]) @ estimated[1:]
    error = np.linalg.inv(true_motion) @ motion
    return _statistics(np.linalg.norm(error[:, :3, 3], axis=1)), _statistics(rotation_angle(error[:, :3, :3]))


def _check_pair(true: NDArray[np.float64], estimated: NDArray[np.float64], least: int) -> None:
    if true.shape != estimated.shape or true.shape[1:] != (4, 4):
        raise ValueError(
            f"two trajectories (n, 4, 4) of equal length are needed, got {true.shape} and {estimated.shape}"
        )
    if len(true) < least:
        raise ValueError(f"at least {least} poses are needed, got {len(true)}")


def _statistics(errors: NDArray[np.float64]) -> dict[str, float]:
    return {
        "rmse": float(np.sqrt(np.mean(errors**2))),
        "mean": float(np.mean(errors)),
        "median": float(np.median(errors)),
    }
