"""Finds the colour, depth and camera_info topics of a bag, by their types and the drivers' names."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from spot3d.source.errors import SourceError

IMAGE, COMPRESSED, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/CameraInfo"
_TRANSPORT = re.compile(r"/(compressed|compressedDepth)$")
_NO_CAMERA = re.compile(r"infra|/ir\b|/ir_|/ir/|fisheye|confidence|thermal|theora|mask|disparity|debug")
# Drivers' names for an image that is registered with the other camera's (RealSense, Azure Kinect, OpenNI), and for a
# rectified one.
_REGISTERED = re.compile(r"aligned_depth_to_colou?r|depth_to_rgb|depth_registered|[hs]w_registered|rgb_to_depth")
_RECTIFIED = re.compile(r"rect")
_TELLING = re.compile(r"depth|rgb|colou?r")


@dataclass(frozen=True, slots=True)
class TopicNames:
    """Topics that a user names. Empty: colour and depth are found by type and name, and there are no poses."""

    colour: str = ""
    depth: str = ""
    pose: str = ""


@dataclass(frozen=True, slots=True)
class CameraTopics:
    """The topics that are played. An info is None if there is no camera_info beside the images."""

    colour: str
    depth: str
    colour_info: str | None
    depth_info: str | None


def find_topics(types: Mapping[str, str], names: TopicNames) -> CameraTopics:
    """Colour and depth of one camera. types: message type of each topic.

    Among several pairs, it prefers a colour topic that is named so, then images registered with each other, of the same
    camera, rectified, and uncompressed. Raises SourceError that names what is missing, and what there is.
    """
    images = sorted(topic for topic, kind in types.items() if kind in (IMAGE, COMPRESSED))
    depths = _named(names.depth, images, types) or [topic for topic in images if _is_depth(topic)]
    colours = _named(names.colour, images, types) or [topic for topic in images if _is_colour(topic)]
    for what, option, found in (("depth", "--depth-topic", depths), ("colour", "--colour-topic", colours)):
        if not found:
            raise SourceError(f"found no {what} topic among: {_listed(types)}; name it with {option}")
    _, chosen_colour, chosen_depth = min((_cost(c, d), c, d) for c in colours for d in depths)
    return CameraTopics(chosen_colour, chosen_depth, info_of(chosen_colour, types), info_of(chosen_depth, types))


def info_of(image: str, types: Mapping[str, str]) -> str | None:
    """The camera_info topic beside an image topic, with or without a transport's suffix. None if there is none."""
    namespace = _TRANSPORT.sub("", image).rpartition("/")[0]
    beside = f"{namespace}/camera_info"
    return beside if types.get(beside) == INFO else None


def _named(name: str, images: list[str], types: Mapping[str, str]) -> list[str]:
    if name and name not in images:
        kind = types.get(name)
        what = f"has type {kind}, not an image type" if kind else f"is not in the bag; it contains: {_listed(types)}"
        raise SourceError(f"the topic {name} {what}")
    return [name] if name else []


def _is_depth(topic: str) -> bool:
    # Only the last names count: /depth_camera/rgb/image_raw is a colour image.
    return "depth" in _kind(topic) and not _NO_CAMERA.search(topic) and "rgb_to_depth" not in topic


def _is_colour(topic: str) -> bool:
    return ("depth" not in _kind(topic) or "rgb_to_depth" in topic) and not _NO_CAMERA.search(topic)


def _kind(topic: str) -> str:
    """The last two names of a topic without its transport, or three where two tell neither depth nor colour."""
    suffix = "depth" if topic.endswith("/compressedDepth") else ""
    names = _TRANSPORT.sub("", topic).split("/")
    last = "/".join(names[-2:])
    return (last if _TELLING.search(last) else "/".join(names[-3:])) + suffix


def _cost(colour: str, depth: str) -> tuple[bool, bool, int, int, int, int]:
    """Cost by falling weight: no colour by name, unregistered, other camera, unrectified, compressed, long names."""
    registered = bool(_REGISTERED.search(depth)) != ("rgb_to_depth" in colour)
    ours, theirs = colour.split("/"), depth.split("/")
    shared = 0
    while shared < min(len(ours), len(theirs)) - 1 and ours[shared] == theirs[shared]:
        shared += 1
    coloured = bool(re.search(r"rgb|colou?r", colour))
    bent = sum(not _RECTIFIED.search(topic) for topic in (colour, depth))
    packed = sum(bool(_TRANSPORT.search(topic)) for topic in (colour, depth))
    return (not coloured, not registered, -shared, bent, packed, len(colour) + len(depth))


def _listed(types: Mapping[str, str]) -> str:
    return ", ".join(f"{topic} ({kind.split('/')[-1]})" for topic, kind in sorted(types.items())) or "no topics"
