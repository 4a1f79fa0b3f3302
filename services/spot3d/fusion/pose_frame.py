"""Where the map of the frames' poses lies in the world."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import invert


@dataclass(frozen=True, slots=True, eq=False)
class PoseFrame:
    """The frame in which keyframes are kept; it moves in the world as its place becomes better known.

    T_world_map: (4, 4), its pose as of the last frame; given_by: the provider of that frame's pose; T_theirs_map:
    (4, 4), this frame in that provider's map, as each provider's map begins elsewhere.
    """

    T_world_map: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    given_by: str | None = None
    T_theirs_map: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def followed(self, T_world_theirs: NDArray[np.float64] | None, given_by: str | None, begun: bool) -> Self:
        """The frame after one more pose.

        T_world_theirs: (4, 4), of the provider's map, None = it never moves; begun: whether a pose came before.
        """
        T_world_theirs = np.eye(4) if T_world_theirs is None else T_world_theirs
        T_theirs_map = self.T_theirs_map
        if begun and given_by != self.given_by:
            T_theirs_map = invert(T_world_theirs) @ self.T_world_map
        return type(self)(T_world_theirs @ T_theirs_map, given_by, T_theirs_map)
