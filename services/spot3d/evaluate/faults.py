"""Faults of sensors and trackers, for input to be degraded by: in poses, in depth, in colour."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.source.scene.noise import FOCAL_PX, block_noise

Pose = NDArray[np.float64] | None
CORRELATION_FRAMES = 10.0
"""Correlation time of errors: about a third of a second at 30 Hz, like drift and the misfit of a marker."""

HOLE_M = 0.03
"""Holes are made of patches about this wide at 1 m, so they are 3 to 10 cm across: glare on a can, a dark label, a wet
spot."""

EDGE = 0.02
"""Depth that is nearer by more than this share belongs to another surface: no slope is as steep within a few pixels."""

BENDS = 4
"""The distortion varies over about the image width divided by this, as a lens's does: a polynomial of a few terms over
the image."""


def shaken(poses: Sequence[Pose], metres: float, degrees: float, seed: int) -> list[Pose]:
    """Poses T_world_camera (4, 4) float64, each rotated and shifted in its camera's frame by a smooth random error.

    The six components of the error are Ornstein-Uhlenbeck processes that start from no error: standard deviation
    `metres` and `degrees` along each axis, correlation time ten frames. A frame without a pose stays without. The same
    seed gives the same errors.
    """
    rng, state = np.random.default_rng(seed), np.zeros(6)
    keep = np.exp(-1 / CORRELATION_FRAMES)
    sigma = np.array([metres] * 3 + [np.radians(degrees)] * 3)
    moved = list[Pose]()
    for pose in poses:
        state = keep * state + np.sqrt(1 - keep**2) * rng.normal(size=6) * sigma
        error = np.eye(4)
        error[:3, :3], error[:3, 3] = cv2.Rodrigues(state[3:])[0], state[:3]
        moved.append(None if pose is None else pose @ error)
    return moved


def late(poses: Sequence[Pose], frames: int) -> list[Pose]:
    """Gives each frame the pose of `frames` frames before. The first ones keep the first pose."""
    return [poses[max(0, number - frames)] for number in range(len(poses))]


def misplaced(poses: Sequence[Pose], metres: float, degrees: float, seed: int) -> list[Pose]:
    """Poses of a body that is `metres` from the camera and rotated by `degrees` against it, in random directions.

    It stands for a tracker whose mounting is not known exactly. The same seed gives the same error.
    """
    directions = np.random.default_rng(seed).normal(size=(2, 3))
    shift, axis = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    error = np.eye(4)
    error[:3, :3], error[:3, 3] = cv2.Rodrigues(np.radians(degrees) * axis)[0], metres * shift
    return [None if pose is None else pose @ error for pose in poses]


def darkened(colour: NDArray[np.uint8], photons: float, seed: tuple[int, int]) -> NDArray[np.uint8]:
    """Colour with photon noise, at the brightness that it had.

    colour: (h, w, 3) uint8. photons: of a white pixel; others have fewer in proportion, all Poisson distributed; with 0
    the image is black. seed: of the recording, and the frame.
    """
    if not photons:
        return np.zeros_like(colour)
    rng = np.random.default_rng((*seed, 5))
    counted = rng.poisson(colour * (photons / 255))
    return np.asarray(np.clip(np.rint(counted * (255 / photons)), 0, 255), np.uint8)


def blurred(colour: NDArray[np.uint8], length: int, seed: tuple[int, int]) -> NDArray[np.uint8]:
    """Colour averaged along a line of `length` pixels, in another direction in each frame.

    colour: (h, w, 3) uint8. seed: of the recording, and the frame.
    """
    angle = np.random.default_rng((*seed, 6)).uniform(0, np.pi)
    side = 2 * (length // 2) + 1
    end = (length - 1) / 2 * np.array((np.cos(angle), np.sin(angle)))
    first, last = (tuple(np.rint(side // 2 + sign * end).astype(int).tolist()) for sign in (-1, 1))
    line = cv2.line(np.zeros((side, side), np.float32), first, last, 1.0)
    return np.asarray(cv2.filter2D(colour, -1, line / line.sum()), np.uint8)


def noisier(
    depth: NDArray[np.float32], camera: Intrinsics, factor: float, seed: tuple[int, int]
) -> NDArray[np.float32]:
    """Depth with `factor` times the sensor's standard deviation of noise (`depth_noise.py`).

    depth: (h, w) float32 metres, 0 = invalid and stays so. The added noise, like a Kinect's, is alike within blocks of
    7 px, which are half as wide at half size. seed: of the recording, and the frame.
    """
    if factor <= 1:
        return depth
    step = max(1, round(FOCAL_PX / camera.fx))
    state = np.random.SeedSequence((*seed, 3)).generate_state(1, np.uint64)[0]
    height, width = depth.shape
    field = block_noise(step * height, step * width, np.uint64(state))[::step, ::step]
    added = np.float32(np.sqrt(factor**2 - 1)) * camera.noise.sigma(depth) * field
    return np.where(depth > 0, np.maximum(depth + added, np.float32(0)), np.float32(0)).astype(np.float32)


def mixed(depth: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Depth averaged over the valid pixels within `reach` pixels, as at edges of cameras that mix or smooth depth.

    depth: (h, w) float32 metres, 0 = invalid and stays so.
    """
    side = 2 * reach + 1
    share = cv2.blur((depth > 0).astype(np.float32), (side, side))
    return np.where(depth > 0, cv2.blur(depth, (side, side)) / np.maximum(share, 1e-6), 0).astype(np.float32)


def fattened(depth: NDArray[np.float32], reach: int) -> NDArray[np.float32]:
    """Depth in which near surfaces grow over what is behind them, as block matching does at edges.

    depth: (h, w) float32 metres, 0 = invalid and stays so. reach: pixels, half of a stereo camera's window.
    """
    window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    nearest = cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), window)
    return np.where(nearest < (1 - EDGE) * depth, nearest, depth).astype(np.float32)


def bent(depth: NDArray[np.float32], deviation: float, seed: int) -> NDArray[np.float32]:
    """Depth with a distortion by a share that varies over the image: too long in some parts, too short in others.

    depth: (h, w) float32 metres, 0 = invalid and stays so. deviation: of the share over the image; its mean is 0, as a
    common share is a scale. seed: of the camera; the distortion is the same in each of its frames.
    """
    field = _smooth(depth.shape, depth.shape[1] // BENDS, np.random.default_rng((seed, 5)))
    share = deviation * (field - field.mean()) / field.std()
    return np.asarray(depth * (1 + share), np.float32)


def torn(depth: NDArray[np.float32], camera: Intrinsics, share: float, seed: tuple[int, int]) -> NDArray[np.float32]:
    """Depth without `share` of its valid pixels, which are lost in blobs.

    depth: (h, w) float32 metres, 0 = invalid. The pixels with the highest smooth random noise are lost, so that the
    share is exact to a pixel. seed: of the recording, and the frame: each frame has other blobs.
    """
    valid = np.flatnonzero(depth > 0)
    lost = round(share * len(valid))
    if not lost:
        return depth
    cell = max(1, round(HOLE_M * camera.fx))
    field = _smooth(depth.shape, cell, np.random.default_rng((*seed, 4)))
    out = depth.copy()
    out.ravel()[valid[np.argpartition(-field.ravel()[valid], lost - 1)[:lost]]] = 0
    return out


def _smooth(shape: tuple[int, ...], cell: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Smooth random noise (h, w) that varies over about `cell` pixels."""
    height, width = shape
    coarse = rng.normal(size=(height // cell + 2, width // cell + 2))
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.float64)
