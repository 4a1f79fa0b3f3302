"""Registration of a frame to a local map: result, registrars' interface, and refinement against a map of planes."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from spot3d.pose.motion import moved, rigid, shift_and_turn
from spot3d.pose.settings import PoseSettings
from spot3d.pose.surface import Surface
from spot3d.pose.surfel_map import SurfelMap

DISTANCE = 0.05
"""Largest distance between a point and its matched plane, metres."""
RECOVERY_DISTANCE = 0.02
"""The same for relocalisation after a loss."""
KERNEL = 4.5
"""Scale of the robust kernel, in standard deviations of the depth noise."""
OVERLAP_MIN = 0.5
"""Share of points that must match the map."""
RESIDUAL_MAX = 0.015
"""Largest root mean square distance of the matched points to the map, metres."""
SAME_PLACE = 0.10
"""Places this close to each other are one place, metres."""
_SAME_TURN = np.radians(5.0)
# Gauss-Newton steps at most.
_STEPS = 8
# The first Gauss-Newton steps are coarse: part of the points is enough.
_COARSE_STRIDE, _FINE_STRIDE = 6, 1
# Steps below this (metres, radians) end a level of the refinement.
_COARSE_STEP, _FINE_STEP = 2e-3, 3e-4
# Fewer matched points than this give no step.
_POINTS_MIN = 20
_RIDGE = 1e-9
# A share of the points is enough to judge a fit.
_STRIDE = 4


@dataclass(frozen=True, slots=True)
class Registration:
    """A frame registered to the local map.

    T_world_camera: (4, 4) float64; overlap: share of the points that match the map, [0, 1];
    residual: root mean square distance of the matched points to the map, metres.
    """

    T_world_camera: NDArray[np.float64]
    overlap: float
    residual: float

    @property
    def fits(self) -> bool:
        """Whether overlap and residual are good enough to track the frame."""
        return self.overlap >= OVERLAP_MIN and self.residual <= RESIDUAL_MAX


class Registrar(Protocol):
    """A local map and the way to register a frame to it; it changes its map only in `insert`."""

    def register(self, surface: Surface, T_world_guess: NDArray[np.float64], wide: bool) -> Registration:
        """Register the surface starting from a guess; `wide` searches further, for a poor guess."""

    def insert(self, surface: Surface, T_world_camera: NDArray[np.float64]) -> None:
        """Add a frame whose registration was accepted."""

    @property
    def planes(self) -> SurfelMap:
        """The map of planes, from which `restored` can rebuild the other maps."""

    def restored(self) -> None:
        """Rebuild the other maps after the map of planes was replaced by that of an earlier process."""


def judged(
    planes: SurfelMap, surface: Surface, T_world_camera: NDArray[np.float64], distance: float = DISTANCE
) -> Registration:
    """How well a surface at a pose fits the map: a point matches it within `distance` metres of its plane."""
    _, _, (tried, matched, squares) = planes.normal_equations(surface, T_world_camera, distance, 1.0, _STRIDE)
    return Registration(T_world_camera, matched / max(tried, 1), (squares / max(matched, 1)) ** 0.5)


def information_of_structure(
    planes: SurfelMap, surface: Surface, T_world_camera: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Information (6, 6) on the pose from the structure that a surface and the map share, 1/m2 and 1/rad2.

    For a shift and a turn about the camera in its own axes. It leaves out the information of noise, as over a bare
    floor.
    """
    turn, shared = np.kron(np.eye(2), T_world_camera[:3, :3]), np.zeros((6, 6))
    planes.normal_equations(surface, T_world_camera, DISTANCE, KERNEL, shared=shared)
    values, directions = np.linalg.eigh(turn.T @ (0.5 * (shared + shared.T)) @ turn)
    return np.asarray(directions * np.maximum(values, 0) @ directions.T)


def refined(
    planes: SurfelMap, surface: Surface, T_world_camera: NDArray[np.float64], distance: float = DISTANCE
) -> NDArray[np.float64]:
    """The pose (4, 4) near the given one at which points within `distance` metres of their planes fit them best.

    Gauss-Newton: on a share of the points until the steps are small, then on more of them.
    """
    pose, stride = T_world_camera, _COARSE_STRIDE
    for _ in range(_STEPS):
        H, g, (_, matched, _) = planes.normal_equations(surface, pose, distance, KERNEL, stride)
        if matched < _POINTS_MIN:
            break
        # The ridge only keeps an unconstrained direction where it is.
        step = np.linalg.solve(H + _RIDGE * np.trace(H) * np.eye(6), g)
        pose = moved(pose, step)
        size = np.abs(step).max()
        if stride > _FINE_STRIDE and size < _COARSE_STEP:
            stride = _FINE_STRIDE
        elif size < _FINE_STEP:
            break
    return rigid(pose)


def implausible(
    registration: Registration,
    T_world_last: NDArray[np.float64],
    elapsed: float,
    overlap_min: float,
    settings: PoseSettings,
) -> str:
    """Why a registration cannot be trusted, or an empty string.

    T_world_last: (4, 4) last good pose, `elapsed` seconds before.
    """
    shift, turn = shift_and_turn(T_world_last, registration.T_world_camera)
    if registration.overlap < overlap_min:
        return f"{registration.overlap:.0%} of the points overlap the map, but {overlap_min:.0%} are needed"
    if not registration.residual <= RESIDUAL_MAX:
        return f"points are {1e3 * registration.residual:.1f} mm away from the map"
    if shift > settings.speed_max * elapsed:
        return f"an implausible motion of {shift:.2f} m in {elapsed:.3f} s"
    if turn > settings.turn_max * elapsed:
        return f"an implausible turn of {np.degrees(turn):.0f} deg in {elapsed:.3f} s"
    return ""


def best_of(tried: list[Registration]) -> Registration:
    """The registration with the largest overlap."""
    return max(tried, key=lambda registration: registration.overlap)


def elsewhere(T_world_a: NDArray[np.float64], T_world_b: NDArray[np.float64]) -> bool:
    """Whether two poses (4, 4) are of different places, farther apart than `SAME_PLACE` or 5 degrees."""
    shift, turn = shift_and_turn(T_world_a, T_world_b)
    return bool(shift > SAME_PLACE or turn > _SAME_TURN)
