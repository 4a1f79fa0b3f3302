"""Where the poses that frames come with lie in the world."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import invert


@dataclass(frozen=True, slots=True, eq=False)
class PoseFrame:
    """The frame in which keyframes are kept: it slides in the world as it is better known where it lies.

    T_world_map: (4, 4) where it lay by the last frame; given_by: who gave that pose; T_theirs_map: (4, 4) this frame in
    that of who gives the poses: somebody else's begins elsewhere.
    """

    T_world_map: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    given_by: str | None = None
    T_theirs_map: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def followed(self, T_world_theirs: NDArray[np.float64] | None, given_by: str | None, begun: bool) -> Self:
        """Where it lies by one more frame. T_world_theirs: (4, 4) of who gives its pose, None = it never slides; begun:
        whether a frame came before."""
        T_world_theirs = np.eye(4) if T_world_theirs is None else T_world_theirs
        T_theirs_map = self.T_theirs_map
        if begun and given_by != self.given_by:
            T_theirs_map = invert(T_world_theirs) @ self.T_world_map
        return type(self)(T_world_theirs @ T_theirs_map, given_by, T_theirs_map)
