"""Moves the 3D view of a browser to a target."""

import time

import numpy as np
import viser
from numpy.typing import NDArray

_FLIGHT_S, _STEPS = 0.6, 24
_ASIDE = np.radians(-35)
"""Angle of the overview beside the camera's direction, so that the camera's image does not hide the scene."""


def fly(client: viser.ClientHandle, place: NDArray[np.float64], target: NDArray[np.float64]) -> None:
    """Move one browser's view smoothly to `place`, looking at `target`; (3,) each, in the view's world."""
    start, looked = np.array(client.camera.position), np.array(client.camera.look_at)
    for step in range(1, _STEPS + 1):
        share = 0.5 - 0.5 * np.cos(np.pi * step / _STEPS)
        with client.atomic():
            client.camera.position = start + share * (place - start)
            client.camera.look_at = looked + share * (target - looked)
        time.sleep(_FLIGHT_S / _STEPS)


def place_before(client: viser.ClientHandle, target: NDArray[np.float64], extent: float) -> NDArray[np.float64]:
    """A place from which a target of this extent is seen well, on the side of the current view."""
    way = np.array(client.camera.position) - target
    way[2] = max(way[2], 0.5 * float(np.linalg.norm(way[:2])), 1e-3)
    place: NDArray[np.float64] = target + way / np.linalg.norm(way) * max(0.4, 3.0 * extent)
    return place


def overview(
    client: viser.ClientHandle, middle: NDArray[np.float64], extent: float, ahead: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A place beside the camera and above, from which a world of this extent is seen; ahead: (3,) where it looks."""
    flat = np.array([ahead[0], ahead[1], 0.0])
    flat = flat / max(1e-6, float(np.linalg.norm(flat)))
    right = np.array([flat[1], -flat[0], 0.0])
    way = np.cos(_ASIDE) * flat + np.sin(_ASIDE) * right
    far = 0.6 * extent / min(1.0, client.camera.aspect)
    place: NDArray[np.float64] = middle - far * way + np.array([0.0, 0.0, 0.9 * far])
    return place
