"""The camera's poses from a bag's /tf, or from the messages of an odometry or a tracker."""

import logging
from collections.abc import Callable, Mapping
from typing import Any

from spot3d.source.errors import SourceError
from spot3d.source.motion import Motion, Pose
from spot3d.source.ros.bag import Bag
from spot3d.source.ros.transforms import TransformTree, stamp_of, transform_of
from spot3d.source.text_files import well_formed

log = logging.getLogger(__name__)

TF = "tf2_msgs/msg/TFMessage"
_ODOMETRY, _TRANSFORM = "nav_msgs/msg/Odometry", "geometry_msgs/msg/TransformStamped"
_POSE, _POSE_COVARIANCE = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped"
_TAKEN = (_ODOMETRY, _TRANSFORM, _POSE, _POSE_COVARIANCE, TF, "tf/msg/tfMessage")

PoseAt = Callable[[int], Pose | None]
"""T_world_camera (4, 4) float64 at a stamp in ns. None where it is unknown."""


def transform_tree(bag: Bag, dynamic: bool) -> TransformTree:
    """The transforms of the bag's /tf_static, and also of /tf if `dynamic`."""
    static = [one for _, _, message in bag.messages("/tf_static") for one in message.transforms]
    moving = [one for _, _, message in bag.messages("/tf") for one in message.transforms] if dynamic else []
    return TransformTree.of(static, moving)


def poses_of(bag: Bag, topic: str, camera_frame: str) -> PoseAt:
    """The camera's poses from a topic.

    topic: Odometry or TransformStamped, whose child frame /tf_static connects with the camera's (optical) frame, or the
    camera's own pose if they name none, which is logged; PoseStamped, with or without covariance, as the camera's own
    pose; or /tf. `/tf:FRAME` names a world other than the root of the camera's tree. Raises SourceError, which names
    what is missing.
    """
    name, _, world = topic.partition(":")
    kind = bag.types.get(name)
    if kind not in _TAKEN:
        raise SourceError(f"{bag.path}: {name} is not a pose topic; choose one of: {_candidates(bag.types)}")
    try:
        if kind in (TF, "tf/msg/tfMessage"):
            return _of_tree(transform_tree(bag, dynamic=True), camera_frame, world)
        return _of_messages(bag, name, kind, camera_frame)
    except ValueError as error:
        raise SourceError(f"{bag.path}: {name}: {error}") from error


def _of_tree(tree: TransformTree, camera_frame: str, world: str) -> PoseAt:
    world = world or tree.root(camera_frame)
    if world == camera_frame.removeprefix("/") or not tree.connected(world, camera_frame):
        raise SourceError(f"/tf and /tf_static do not connect {world} with the camera's frame {camera_frame}")
    return lambda stamp_ns: tree.between(world, camera_frame, stamp_ns)


def _of_messages(bag: Bag, topic: str, kind: str, camera_frame: str) -> PoseAt:
    messages = [message for _, _, message in bag.messages(topic)]
    body = getattr(messages[-1], "child_frame_id", "") if messages else ""
    if not body and kind in (_ODOMETRY, _TRANSFORM):
        log.warning("%s names no child frame: its poses are taken as the camera's own, of its optical frame", topic)
    motion = Motion(well_formed(messages, lambda one: (stamp_of(one), _pose(one, kind)), f"poses of {topic}"))
    T_body_camera = transform_tree(bag, dynamic=False).fixed_between(body, camera_frame) if body else None
    if body and T_body_camera is None:
        raise SourceError(
            f"{topic} gives poses of {body}, but /tf_static does not connect it with the camera's frame "
            f"{camera_frame}; record /tf_static as well, or use --pose /tf"
        )

    def pose_at(stamp_ns: int) -> Pose | None:
        pose = motion.at(stamp_ns)
        return pose if pose is None or T_body_camera is None else pose @ T_body_camera

    return pose_at


def _pose(message: Any, kind: str) -> Pose:
    if kind == _TRANSFORM:
        return transform_of(message.transform.translation, message.transform.rotation)
    pose = message.pose if kind == _POSE else message.pose.pose
    return transform_of(pose.position, pose.orientation)


def _candidates(types: Mapping[str, str]) -> str:
    found = sorted(topic for topic, kind in types.items() if kind in _TAKEN and topic != "/tf_static")
    return ", ".join(found) or "none (supported are Odometry, PoseStamped, TransformStamped and /tf)"
