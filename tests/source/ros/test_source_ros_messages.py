import struct
import zlib

import cv2
import numpy as np
import pytest
from bag_writer import Speaker

from spot3d.camera import invert
from spot3d.source.errors import SourceError
from spot3d.source.motion import Motion
from spot3d.source.ros.images import colour_image, depth_image
from spot3d.source.ros.topics import COMPRESSED, IMAGE, INFO, TopicNames, find_topics
from spot3d.source.ros.transforms import TransformTree

SPEAKER = Speaker(2)
RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 256, (5, 7, 3), np.uint8)
MILLIMETRES = RNG.integers(0, 4000, (5, 7), np.uint16)
METRES = (MILLIMETRES / 1000).astype(np.float32)


@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("rgb8", RGB, RGB),
        ("bgr8", np.ascontiguousarray(RGB[..., ::-1]), RGB),
        ("bgra8", np.dstack((RGB[..., ::-1], RGB[..., :1])), RGB),
        ("mono8", RGB[..., 0].copy(), np.repeat(RGB[..., :1], 3, axis=2)),
    ],
)
def test_colour_images(encoding: str, pixels: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_array_equal(colour_image(SPEAKER.image(0, "c", encoding, pixels)), expected)


def test_depth_images() -> None:
    np.testing.assert_array_equal(depth_image(SPEAKER.image(0, "c", "16UC1", MILLIMETRES)), MILLIMETRES)
    swapped = SPEAKER.image(0, "c", "16UC1", MILLIMETRES.astype(">u2"), bigendian=1)
    np.testing.assert_array_equal(depth_image(swapped), MILLIMETRES)
    holes = METRES.copy()
    holes[0, :3] = np.nan, np.inf, -1
    expected = METRES.copy()
    expected[0, :3] = 0
    np.testing.assert_array_equal(depth_image(SPEAKER.image(0, "c", "32FC1", holes)), expected)


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def far_too_large() -> bytes:
    """A PNG that says it is 200,000 x 200,000 pixels."""
    data = bytearray(png(MILLIMETRES))
    data[16:24] = struct.pack(">II", 200_000, 200_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    return bytes(data)


def test_compressed_images() -> None:
    message = SPEAKER.compressed(0, "c", "rgb8; png compressed bgr8", png(RGB[..., ::-1]))
    np.testing.assert_array_equal(colour_image(message), RGB)
    np.testing.assert_array_equal(depth_image(SPEAKER.compressed(0, "c", "png", png(MILLIMETRES))), MILLIMETRES)
    header = struct.pack("<iff", 0, 0, 0)
    packed = SPEAKER.compressed(0, "c", "16UC1; compressedDepth png", header + png(MILLIMETRES))
    np.testing.assert_array_equal(depth_image(packed), MILLIMETRES)


def test_compressed_float_depth_is_inverse_depth_in_steps() -> None:
    # compressed_depth_image_transport: steps of a / z + b, for depth_max 10 m and quantisation 100.
    a = 100.0 * (100.0 + 1)
    b = 1 - a / 10.0
    steps = np.where(METRES > 0.2, np.rint(a / np.maximum(METRES, 0.2) + b), 0).astype(np.uint16)
    message = SPEAKER.compressed(0, "c", "32FC1; compressedDepth", struct.pack("<iff", 0, a, b) + png(steps))
    read = depth_image(message)
    assert read.dtype == np.float32
    np.testing.assert_allclose(read[steps > 0], METRES[steps > 0], rtol=1e-3)
    assert not read[steps == 0].any()


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (SPEAKER.image(0, "c", "yuv422", RGB), "a colour image has the encoding 'yuv422'; supported are rgb8"),
        (SPEAKER.compressed(0, "c", "jpeg", b"\xff\xd8 not a picture"), "cannot be decoded as PNG or JPEG"),
        (SPEAKER.compressed(0, "c", "jpeg", b""), "0 bytes"),
        (SPEAKER.compressed(0, "c", "png", far_too_large()), "cannot be decoded as PNG or JPEG"),
    ],
)
def test_colour_that_cannot_be_read_is_told(message: object, expected: str) -> None:
    with pytest.raises(SourceError, match=expected):
        colour_image(message)


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (
            SPEAKER.image(0, "c", "8UC1", MILLIMETRES.astype(np.uint8)),
            "a depth image has the encoding '8UC1'; supported are 16UC1",
        ),
        (SPEAKER.compressed(0, "c", "jpeg", png(RGB)), r"compressed depth is uint8.*expected one channel of 16 bits"),
    ],
)
def test_depth_that_cannot_be_read_is_told(message: object, expected: str) -> None:
    with pytest.raises(SourceError, match=expected):
        depth_image(message)


def test_an_image_that_is_shorter_than_it_says_is_told() -> None:
    message = SPEAKER.image(0, "c", "16UC1", MILLIMETRES)
    message.height = 50
    with pytest.raises(SourceError, match="an image of 7x50 16UC1 has 17 bytes per row and 85 in total"):
        depth_image(message)


@pytest.mark.parametrize(
    ("images", "colour", "depth"),
    [
        (  # realsense2_camera
            "/camera/color/image_raw /camera/depth/image_rect_raw /camera/aligned_depth_to_color/image_raw "
            "/camera/infra1/image_rect_raw /camera/color/image_raw/compressed",
            "/camera/color/image_raw",
            "/camera/aligned_depth_to_color/image_raw",
        ),
        (  # its names in ROS 2, without aligned depth
            "/camera/camera/color/image_raw /camera/camera/depth/image_rect_raw /camera/camera/infra2/image_rect_raw",
            "/camera/camera/color/image_raw",
            "/camera/camera/depth/image_rect_raw",
        ),
        (  # Azure Kinect
            "/rgb/image_raw /depth/image_raw /depth_to_rgb/image_raw /ir/image_raw",
            "/rgb/image_raw",
            "/depth_to_rgb/image_raw",
        ),
        ("/rgb_to_depth/image_raw /depth/image_raw /ir/image_raw", "/rgb_to_depth/image_raw", "/depth/image_raw"),
        (  # openni2_launch
            "/camera/rgb/image_raw /camera/rgb/image_rect_color /camera/depth/image_raw "
            "/camera/depth_registered/image_raw /camera/ir/image_raw",
            "/camera/rgb/image_rect_color",
            "/camera/depth_registered/image_raw",
        ),
        (
            "/rgb/image_raw/compressed /depth/image/compressedDepth",
            "/rgb/image_raw/compressed",
            "/depth/image/compressedDepth",
        ),
        (  # rgbd_launch, as of other OpenNI drivers
            "/camera/rgb/image_rect_color /camera/depth/sw_registered/image_rect_raw /camera/depth/image_raw",
            "/camera/rgb/image_rect_color",
            "/camera/depth/sw_registered/image_rect_raw",
        ),
        (  # a namespace that speaks of depth
            "/depth_camera/rgb/image_raw /depth_camera/depth/image_raw",
            "/depth_camera/rgb/image_raw",
            "/depth_camera/depth/image_raw",
        ),
        ("/a/color/image_raw /b/color/image_raw /b/depth/image_raw", "/b/color/image_raw", "/b/depth/image_raw"),
    ],
)  # fmt: skip
def test_topics_are_found_by_the_drivers_names(images: str, colour: str, depth: str) -> None:
    types = {topic: COMPRESSED if "compressed" in topic else IMAGE for topic in images.split()}
    types |= {"/imu": "sensor_msgs/msg/Imu", "/depth/points": "sensor_msgs/msg/PointCloud2"}
    for topic in (colour, depth):
        base = topic.removesuffix("/compressed").removesuffix("/compressedDepth")
        types[base.rpartition("/")[0] + "/camera_info"] = INFO
    found = find_topics(types, TopicNames())
    assert (found.colour, found.depth) == (colour, depth)
    assert found.colour_info in types
    assert found.depth_info in types


def turned(degrees: float, x: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0, x], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def test_poses_between_stamps() -> None:
    motion = Motion([(100_000_000, turned(10, 1.0)), (0, turned(0, 0.0)), (600_000_000, turned(20, 2.0))])
    np.testing.assert_allclose(motion.at(50_000_000), turned(5, 0.5), atol=1e-9)
    np.testing.assert_array_equal(motion.at(100_000_000), turned(10, 1.0))
    for unknown in (-1, 600_000_001, 300_000_000):  # before, after, and in a gap of half a second
        assert motion.at(unknown) is None
    assert Motion([]).at(0) is None


def test_the_tree_of_transforms() -> None:
    T_base_camera, T_base_tool = turned(90, 0.2), turned(0, 0.7)
    static = [
        SPEAKER.transform(0, "/base", "camera", T_base_camera),
        SPEAKER.transform(0, "base", "tool", T_base_tool),
    ]
    moving = [SPEAKER.transform(stamp, "odom", "base", turned(0, stamp * 1e-8)) for stamp in (0, 100_000_000)]
    moving += [SPEAKER.transform(stamp, "map", "odom", turned(0, 5.0)) for stamp in (0, 100_000_000)]
    tree = TransformTree.of(static, moving)
    np.testing.assert_allclose(tree.fixed_between("tool", "camera"), invert(T_base_tool) @ T_base_camera, atol=1e-9)
    assert tree.fixed_between("odom", "camera") is None
    assert tree.root("camera") == "map"
    np.testing.assert_allclose(tree.between("map", "camera", 50_000_000), turned(0, 5.5) @ T_base_camera, atol=1e-9)
    np.testing.assert_allclose(tree.between("odom", "/camera", 50_000_000), turned(0, 0.5) @ T_base_camera, atol=1e-9)
    assert tree.between("map", "camera", 900_000_000) is None
    assert tree.between("map", "elsewhere", 0) is None
