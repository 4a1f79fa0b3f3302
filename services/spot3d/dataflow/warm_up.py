"""Loads kernels, or compiles those not cached, before a stage goes on line, so that no frame waits for them."""

import logging
import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame

_CAMERA = Intrinsics(140.0, 140.0, 79.5, 59.5, 160, 120)
_FRAMES = 6
"""Enough that some find landmarks of others, which are searched at intervals (PoseSettings.landmark_interval)."""
_SLOW_S = 5.0


def warm_up(stage: str, work: Callable[[Sequence[RgbdFrame]], object]) -> None:
    """Let a stage's core work on a few small frames: a box in a corner. A failure is only logged.

    Raises ModuleNotFoundError where the core lacks a package: every frame would fail.
    """
    log = logging.getLogger(f"spot3d.{stage}")
    start_s = time.monotonic()
    word = threading.Timer(
        _SLOW_S, log.info, ("compiling kernels before going on line; this takes up to some minutes, only once",)
    )
    word.daemon = True
    word.start()
    try:
        work([_frame(index) for index in range(_FRAMES)])
    except ModuleNotFoundError:
        raise
    except Exception as error:
        log.warning("cannot warm up the kernels: %s: %s", type(error).__name__, error)
    finally:
        word.cancel()
    took_s = time.monotonic() - start_s
    if took_s > _SLOW_S:
        log.info("compiled the kernels in %.0f s; they are cached for the next start", took_s)


def _frame(index: int) -> RgbdFrame:
    """A box at 0.8 m, before a wall at 1.2 m; the camera moves by a millimetre a frame and knows its pose.

    The floor is 0.4 m below the camera and another wall 0.5 m to its right, so that every direction is observed.
    """
    below = np.maximum(np.arange(_CAMERA.height) - _CAMERA.cy, 1) / _CAMERA.fy
    right = np.maximum(np.arange(_CAMERA.width) - _CAMERA.cx, 1) / _CAMERA.fx
    metres = np.minimum(1.2, np.minimum(0.4 / below[:, None], 0.5 / right[None, :]))
    colour = np.full((*_CAMERA.shape, 3), (90, 110, 130), np.uint8)
    depth = np.rint(1000 * metres).astype(np.uint16)
    colour[40:80, 60:100] = (200, 60, 40)
    depth[40:80, 60:100] = 800
    pose = np.eye(4)
    # Not along voxel borders, across which the walls would jump.
    pose[:3, 3] = 0.02
    pose[0, 3] += 1e-3 * index
    return RgbdFrame(index * 33_000_000, colour, depth, 1e-3, _CAMERA, pose)
