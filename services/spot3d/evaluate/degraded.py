"""A sequence with degraded poses, intrinsics, depth or colour. Its true poses remain the truth."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.evaluate.faults import bent, blurred, darkened, fattened, late, misplaced, mixed, noisier, shaken, torn
from spot3d.frame import RgbdFrame
from spot3d.source.selected import Selected
from spot3d.source.sequence import Derived, FrameSequence

SEED = 1


@dataclass(frozen=True, slots=True)
class Degradation:
    """The errors to add to a sequence. Several can be combined.

    metres, degrees: deviation of the poses' smooth error; late: frames by which poses lag; mount: metres and degrees
    between the camera and the body whose poses are given; centre: share of the width by which the stated principal
    point is too low in the image; focal: factor on the stated focal lengths; scale: factor on depth; bent: deviation of
    the camera's own distortion, as a share of depth; noise: factor on the sensor's noise; mixed: radius in pixels over
    which depth is averaged; fattened: pixels by which near surfaces grow; missing: share of depth that is lost;
    photons: of a white pixel; blurred: share of the width over which colour is averaged; every: only each nth frame;
    half: half size.
    """

    metres: float = 0.0
    degrees: float = 0.0
    late: int = 0
    mount: tuple[float, float] = (0.0, 0.0)
    centre: float = 0.0
    focal: float = 1.0
    scale: float = 1.0
    bent: float = 0.0
    noise: float = 1.0
    mixed: int = 0
    fattened: int = 0
    missing: float = 0.0
    photons: float = np.inf
    blurred: float = 0.0
    every: int = 1
    half: bool = False

    def of(self, sequence: FrameSequence) -> FrameSequence:
        """The degraded sequence. Halving comes first, then errors frame by frame, then every nth frame is chosen."""
        worse = sequence.at_half_size() if self.half else sequence
        if replace(self, every=1, half=False) != Degradation():
            worse = _Degraded(worse, self)
        return worse if self.every == 1 else Selected(worse, range(0, len(worse), self.every))


class _Degraded(Derived):
    """Frames of another sequence with wrong poses or intrinsics, or with degraded depth or colour.

    `true_pose` is that of the other sequence: a run with given poses takes those of the frames, and is judged by the
    true ones. Errors depend on a frame's number.
    """

    def __init__(self, sequence: FrameSequence, worse: Degradation) -> None:
        super().__init__(sequence)
        self._worse = worse
        self.intrinsics = self._stated_camera(sequence.intrinsics)
        poses = late([sequence.true_pose(index) for index in range(len(sequence))], worse.late)
        self._told = shaken(misplaced(poses, *worse.mount, SEED), worse.metres, worse.degrees, SEED)

    def __getitem__(self, index: int) -> RgbdFrame:
        frame, number = self.original[index], index % len(self)
        return replace(
            frame,
            colour=self._colour(frame, number),
            depth=self._depth(frame, number),
            depth_scale=1.0,
            intrinsics=self._stated_camera(frame.intrinsics),
            T_world_camera=self._told[number],
        )

    def _stated_camera(self, camera: Intrinsics) -> Intrinsics:
        worse = self._worse
        fx, fy = camera.fx * worse.focal, camera.fy * worse.focal
        return replace(camera, fx=fx, fy=fy, cy=camera.cy + worse.centre * camera.width)

    def _colour(self, frame: RgbdFrame, number: int) -> NDArray[np.uint8]:
        worse, colour = self._worse, frame.colour
        if worse.blurred:
            colour = blurred(colour, round(worse.blurred * frame.intrinsics.width), (SEED, number))
        return darkened(colour, worse.photons, (SEED, number)) if np.isfinite(worse.photons) else colour

    def _depth(self, frame: RgbdFrame, number: int) -> NDArray[np.float32]:
        worse, camera = self._worse, frame.intrinsics
        depth = frame.depth_metres() * np.float32(worse.scale)
        if worse.bent:
            depth = bent(depth, worse.bent, SEED)
        depth = noisier(depth, camera, worse.noise, (SEED, number))
        if worse.mixed:
            depth = mixed(depth, worse.mixed)
        if worse.fattened:
            depth = fattened(depth, worse.fattened)
        return torn(depth, camera, worse.missing, (SEED, number))
