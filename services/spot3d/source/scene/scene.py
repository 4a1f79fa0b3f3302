"""A built-in scene as a sequence of frames, with its ground truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics
from spot3d.frame import RgbdFrame
from spot3d.source.scene.model import TrueBox, build_scene, first_frames
from spot3d.source.scene.name import DEFAULT_KIND, SceneKind
from spot3d.source.scene.noise import measured_depth, noisy_colour
from spot3d.source.scene.path import RATE_HZ, camera_pose
from spot3d.source.scene.render import RenderedView, Renderer, empty_rendered_view
from spot3d.source.sequence import FrameSequence

KINECT = Intrinsics(585.0, 585.0, 320.0, 240.0, 640, 480)
METRES_PER_UNIT = 0.001


@dataclass(eq=False)
class Scene(FrameSequence):
    """A built-in scene: `frames` RgbdFrame at 30 Hz from a hand-held Kinect, rendered on access.

    A frame depends on seed, kind and its index alone. Every frame has its true pose; `boxes`, `up` and `truth` hold the
    other ground truth. World frame: z up, metres. In a scene that changes, `truth` is that of its frame, and `boxes`
    are those of the last frame.
    """

    has_true_poses = True
    rate_hz = float(RATE_HZ)

    seed: int = 0
    kind: SceneKind = DEFAULT_KIND
    frames: int = 300
    intrinsics: Intrinsics = KINECT

    def __post_init__(self) -> None:
        self.stamps_ns = [index * 10**9 // RATE_HZ for index in range(self.frames)]
        self._renderers = {
            first: Renderer(build_scene(self.seed, self.kind, first), self.intrinsics, self.seed)
            for first in first_frames(self.kind)
            if first < max(self.frames, 1)
        }
        self._exact = empty_rendered_view(self.intrinsics.shape)

    @property
    def boxes(self) -> tuple[TrueBox, ...]:
        """True boxes of all objects in the last frame, world frame."""
        return self._renderers[self.settled_from].model.boxes

    @property
    def settled_from(self) -> int:
        """The first frame after the last change."""
        return max(self._renderers)

    @property
    def up(self) -> NDArray[np.float64]:
        """The world's up direction (3,)."""
        return np.array((0.0, 0.0, 1.0))

    def true_pose(self, index: int) -> NDArray[np.float64]:
        return camera_pose(self._index(index), self.seed, self.kind)

    def truth(self, index: int) -> RenderedView:
        """Exact depth, instance mask (0 = no object, else the box's id) and colour of a frame."""
        view = empty_rendered_view(self.intrinsics.shape)
        self._renderer(index).render(self.true_pose(index), view)
        return view

    def __getitem__(self, index: int) -> RgbdFrame:
        """Renders one frame. Raises IndexError beyond the sequence."""
        index = self._index(index)
        stamp_ns, pose = self.stamps_ns[index], self.true_pose(index)
        view = self._exact
        self._renderer(index).render(pose, view)
        depth = measured_depth(view.depth, view.cosine, self.intrinsics.fx, self.seed, index)
        colour = noisy_colour(view.colour, self.seed, index)
        return RgbdFrame(stamp_ns, colour, depth, METRES_PER_UNIT, self.intrinsics, pose)

    def _renderer(self, index: int) -> Renderer:
        """The renderer of the scene as it is in this frame."""
        index = self._index(index)
        return self._renderers[max(first for first in self._renderers if first <= index)]

    def _index(self, index: int) -> int:
        if not -self.frames <= index < self.frames:
            raise IndexError(f"frame {index} of {self.frames}")
        return index % self.frames
