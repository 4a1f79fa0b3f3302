"""The transform tree of /tf and /tf_static, with interpolated poses."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spot3d.camera import invert
from spot3d.source.motion import Motion, Pose
from spot3d.source.text_files import well_formed
from spot3d.trajectory import pose_from_quaternion


def transform_of(translation: Any, rotation: Any) -> Pose:
    """(4, 4) from a message's vector and quaternion. Raises ValueError if that is zero or a value not finite."""
    quaternion = np.array([rotation.x, rotation.y, rotation.z, rotation.w])
    position = np.array([translation.x, translation.y, translation.z])
    if not (np.isfinite(position).all() and np.isfinite(quaternion).all()):
        raise ValueError("a pose contains a value that is not a number")
    return pose_from_quaternion(position, quaternion)


@dataclass(slots=True)
class TransformTree:
    """Frames with their parents: fixed ones, and moving ones."""

    fixed: dict[str, tuple[str, Pose]] = field(default_factory=dict)
    moving: dict[str, tuple[str, Motion]] = field(default_factory=dict)

    @staticmethod
    def of(static: Sequence[Any], dynamic: Sequence[Any] = ()) -> "TransformTree":
        """From the TransformStamped of /tf_static and /tf. Malformed ones are skipped and logged.

        Raises ValueError if all of a topic are malformed.
        """
        tree = TransformTree()
        for child, parent, _, T in well_formed(static, _edge, "transforms of /tf_static"):
            tree.fixed[child] = (parent, T)
        stamped: dict[tuple[str, str], list[tuple[int, Pose]]] = {}
        for child, parent, stamp_ns, T in well_formed(dynamic, _edge, "transforms of /tf"):
            stamped.setdefault((child, parent), []).append((stamp_ns, T))
        for (child, parent), poses in stamped.items():
            if child not in tree.fixed:
                tree.moving[child] = (parent, Motion(poses))
        return tree

    def root(self, frame: str) -> str:
        """The topmost ancestor of a frame."""
        return self._path(frame)[-1]

    def connected(self, target: str, source: str) -> bool:
        """Whether the two frames belong to one tree."""
        return self.root(target) == self.root(source)

    def fixed_between(self, target: str, source: str) -> Pose | None:
        """T_target_source (4, 4) over fixed frames alone. None if there is no such path."""
        up = TransformTree(self.fixed)
        return up.between(target, source, 0) if up.connected(target, source) else None

    def between(self, target: str, source: str, stamp_ns: int) -> Pose | None:
        """T_target_source (4, 4) at a time. None if it is unknown at that time, or the frames are not connected."""
        if not self.connected(target, source):
            return None
        one, other = self._to_root(target, stamp_ns), self._to_root(source, stamp_ns)
        return None if one is None or other is None else invert(one) @ other

    def _path(self, frame: str) -> list[str]:
        path = [_name(frame)]
        while (edge := self.fixed.get(path[-1]) or self.moving.get(path[-1])) and edge[0] not in path:
            path.append(edge[0])
        return path

    def _to_root(self, frame: str, stamp_ns: int) -> Pose | None:
        T = np.eye(4)
        for name in self._path(frame)[:-1]:
            step = self.fixed[name][1] if name in self.fixed else self.moving[name][1].at(stamp_ns)
            if step is None:
                return None
            T = step @ T
        return T


def stamp_of(message: Any) -> int:
    """The stamp of a message's header, ns."""
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def _edge(stamped: Any) -> tuple[str, str, int, Pose]:
    """Child, parent, stamp in ns and T_parent_child (4, 4) of a TransformStamped."""
    T = transform_of(stamped.transform.translation, stamped.transform.rotation)
    return _name(stamped.child_frame_id), _name(stamped.header.frame_id), stamp_of(stamped), T


def _name(frame: str) -> str:
    """The frame's name without the leading slash of early ROS 1."""
    return frame.removeprefix("/")
