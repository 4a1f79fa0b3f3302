"""Moves a browser's view to something."""

import time

import numpy as np
import viser
from numpy.typing import NDArray

_FLIGHT_S, _STEPS = 0.6, 24
_ASIDE = np.radians(-35)
"""So that the camera's own picture does not hide what it looks at."""


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
    """A place from which something of this extent at `target` is seen well, on the side of the view of now."""
    way = np.array(client.camera.position) - target
    way[2] = max(way[2], 0.5 * float(np.linalg.norm(way[:2])), 1e-3)
    place: NDArray[np.float64] = target + way / np.linalg.norm(way) * max(0.4, 3.0 * extent)
    return place


def overview(
    client: viser.ClientHandle, middle: NDArray[np.float64], extent: float, ahead: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A place aside of the camera and above, from which a world of this extent is seen; ahead: (3,) where it looks."""
    flat = np.array([ahead[0], ahead[1], 0.0])
    flat = flat / max(1e-6, float(np.linalg.norm(flat)))
    right = np.array([flat[1], -flat[0], 0.0])
    way = np.cos(_ASIDE) * flat + np.sin(_ASIDE) * right
    far = 0.6 * extent / min(1.0, client.camera.aspect)
    place: NDArray[np.float64] = middle - far * way + np.array([0.0, 0.0, 0.9 * far])
    return place
