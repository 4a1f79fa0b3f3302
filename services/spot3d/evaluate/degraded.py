"""A sequence made worse: its frames come with wrong poses or worse depth, while its true poses stay the truth."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.evaluate.depth_errors import bent, fattened, mixed, noisier, torn
from spot3d.evaluate.pose_errors import Pose, late, misplaced, shaken
from spot3d.frame import RgbdFrame
from spot3d.source.sequence import Derived, FrameSequence

ChangeDepth = Callable[[NDArray[np.float32], Intrinsics, int], NDArray[np.float32]]
"""Depth (h, w) float32 metres of the frame of this number, 0 = invalid, made worse."""
ChangeCamera = Callable[[Intrinsics], Intrinsics]
"""What is told of a camera in the place of what is true."""


class Degraded(Derived):
    """Frames of another sequence, told other poses or intrinsics, or with worse depth.

    `true_pose` is that of the other sequence: a run with given poses takes what its frames tell, and is judged by what
    is true. Errors depend on a frame's number: degrade a whole sequence, and choose every so-manieth frame after that.
    """

    def __init__(
        self,
        sequence: FrameSequence,
        told: Sequence[Pose] | None = None,
        change_depth: ChangeDepth | None = None,
        told_camera: ChangeCamera | None = None,
    ) -> None:
        """told: T_world_camera of each frame, None where it has none; told_camera: the intrinsics told for the true."""
        super().__init__(sequence)
        self._camera = told_camera
        self._told = told
        self._change_depth = change_depth

    def told_poses(self) -> list[Pose]:
        """What the frames say their poses are."""
        return told_poses(self.original) if self._told is None else list(self._told)

    def __getitem__(self, index: int) -> RgbdFrame:
        frame, number = self.original[index], index % len(self)
        if self._told is not None:
            frame = replace(frame, T_world_camera=self._told[number])
        if self._change_depth is not None:
            depth = self._change_depth(frame.depth_metres(), frame.intrinsics, number)
            frame = replace(frame, depth=depth, depth_scale=1.0)
        return replace(frame, intrinsics=self._told_camera(frame.intrinsics))

    @property
    def intrinsics(self) -> Intrinsics:
        """Intrinsics of all frames, as told."""
        return self._told_camera(self.original.intrinsics)

    def _told_camera(self, camera: Intrinsics) -> Intrinsics:
        return camera if self._camera is None else self._camera(camera)


def told_poses(sequence: FrameSequence) -> list[Pose]:
    """T_world_camera that each frame of a sequence will tell, without reading images."""
    if isinstance(sequence, Degraded):
        return sequence.told_poses()
    return [sequence.true_pose(index) for index in range(len(sequence))]


def with_shaken_poses(sequence: FrameSequence, metres: float, degrees: float, seed: int = 1) -> Degraded:
    """The sequence with poses that are smoothly wrong; see `pose_errors.shaken`."""
    return Degraded(sequence, told=shaken(told_poses(sequence), metres, degrees, seed))


def with_late_poses(sequence: FrameSequence, frames: int) -> Degraded:
    """The sequence with the poses of some frames before; see `pose_errors.late`."""
    return Degraded(sequence, told=late(told_poses(sequence), frames))


def with_misplaced_poses(sequence: FrameSequence, metres: float, degrees: float, seed: int = 1) -> Degraded:
    """The sequence with poses of something that is fixed to the camera; see `pose_errors.misplaced`."""
    return Degraded(sequence, told=misplaced(told_poses(sequence), metres, degrees, seed))


def with_wrong_centre(sequence: FrameSequence, share: float) -> Degraded:
    """The sequence with a principal point that is too low by this share of the image's width."""
    return Degraded(sequence, told_camera=lambda camera: replace(camera, cy=camera.cy + share * camera.width))


def with_wrong_focal_length(sequence: FrameSequence, factor: float) -> Degraded:
    """The sequence with focal lengths that are told `factor` times as long as they are."""
    return Degraded(sequence, told_camera=lambda camera: replace(camera, fx=camera.fx * factor, fy=camera.fy * factor))


def with_noisier_depth(sequence: FrameSequence, factor: float, seed: int = 1) -> Degraded:
    """The sequence with more of the sensor's noise; see `depth_errors.noisier`."""
    return Degraded(sequence, change_depth=lambda depth, camera, k: noisier(depth, camera, factor, (seed, k)))


def with_scaled_depth(sequence: FrameSequence, factor: float) -> Degraded:
    """The sequence with depth times `factor`."""
    return Degraded(sequence, change_depth=lambda depth, camera, k: depth * np.float32(factor))


def with_mixed_depth(sequence: FrameSequence, reach: int) -> Degraded:
    """The sequence with depth that is mixed at edges; see `depth_errors.mixed`."""
    return Degraded(sequence, change_depth=lambda depth, camera, k: mixed(depth, reach))


def with_fattened_depth(sequence: FrameSequence, reach: int) -> Degraded:
    """The sequence with near things that have grown by some pixels; see `depth_errors.fattened`."""
    return Degraded(sequence, change_depth=lambda depth, camera, k: fattened(depth, reach))


def with_bent_depth(sequence: FrameSequence, deviation: float, seed: int = 1) -> Degraded:
    """The sequence with depth that its camera distorts; see `depth_errors.bent`."""
    return Degraded(sequence, change_depth=lambda depth, camera, k: bent(depth, deviation, seed))


def with_torn_depth(sequence: FrameSequence, share: float, seed: int = 1) -> Degraded:
    """The sequence with holes in its depth, others in each frame; see `depth_errors.torn`."""
    return Degraded(sequence, change_depth=lambda depth, camera, k: torn(depth, camera, share, (seed, k)))
