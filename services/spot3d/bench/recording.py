"""Writes frames to disk as a recording of any length, so that no rendering affects a run."""

import os
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from spot3d.bench.material import to_and_fro
from spot3d.frame import RgbdFrame
from spot3d.trajectory import write_tum

_UNITS_PER_METRE = 5000
_RATE_HZ = 30
_NAMES = {"rgb": "rgb-{:06d}.ppm", "depth": "depth-{:06d}.pgm"}


def write_recording(folder: Path, frames: Sequence[RgbdFrame], length: int) -> None:
    """Write the frames in the layout of TUM RGB-D, repeated to and fro up to `length`, so that the camera never jumps.

    Images are PPM and PGM, each written once: raw, as a camera gives them, and read about as fast as copied. Poses are
    written if each frame has one.
    """
    folder.mkdir(parents=True)
    for number, frame in enumerate(frames):
        depth = np.rint(frame.depth_metres() * _UNITS_PER_METRE).clip(0, 65535).astype(np.uint16)
        _write(folder / _NAMES["rgb"].format(number), np.ascontiguousarray(frame.colour[..., ::-1]))
        _write(folder / _NAMES["depth"].format(number), depth)
    camera = frames[0].intrinsics
    (folder / "intrinsics.txt").write_text(f"{camera.fx} {camera.fy} {camera.cx} {camera.cy}\n", encoding="ascii")
    stamps = [index * 10**9 // _RATE_HZ for index in range(length)]
    order = [to_and_fro(len(frames), index) for index in range(length)]
    for kind, image in _NAMES.items():
        lines = (f"{s // 10**9}.{s % 10**9:09d} {image.format(n)}\n" for s, n in zip(stamps, order, strict=True))
        (folder / f"{kind}.txt").write_text("".join(lines), encoding="ascii")
    poses = [frames[number].T_world_camera for number in order]
    if all(pose is not None for pose in poses):
        write_tum(folder / "groundtruth.txt", stamps, np.array(poses))


def _write(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    if not cv2.imwrite(os.fspath(path), image):
        raise OSError(f"{path} cannot be written")
