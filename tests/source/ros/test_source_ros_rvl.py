"""Depth images that ROS' compressedDepth has packed by RVL."""

import struct
from pathlib import Path

import numpy as np
import pytest
from bag_writer import Speaker, camera_messages, write_bag

from spot3d.camera import Intrinsics
from spot3d.source.errors import SourceError
from spot3d.source.ros.images import depth_image
from spot3d.source.ros.rvl import _decode, decode_rvl
from spot3d.source.scene.scene import Scene
from spot3d.source.sequences import open_source

CAMERA = Intrinsics(585 / 4, 585 / 4, 80.0, 60.0, 160, 120)
FRAMES = list(Scene(frames=3, intrinsics=CAMERA))
SPEAKER = Speaker(2)
RNG = np.random.default_rng(0)


def rvl(image: np.ndarray) -> bytes:
    """An image as compressed_depth_image_transport packs it: size, then RVL as its author publishes it."""
    pixels, nibbles, at, previous = image.ravel().tolist(), [], 0, 0

    def write(value: int) -> None:
        while value > 7:
            nibbles.append(8 | value & 7)
            value >>= 3
        nibbles.append(value)

    def run(zero: bool) -> int:
        end = at
        while end < len(pixels) and (pixels[end] == 0) == zero:
            end += 1
        return end - at

    while at < len(pixels):
        zeros = run(True)
        write(zeros)
        at += zeros
        others = run(False)
        write(others)
        for value in pixels[at : at + others]:
            delta = value - previous
            write(delta << 1 ^ delta >> 31)
            previous = value
        at += others
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{nibble:x}" for nibble in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    height, width = image.shape
    return struct.pack(f"<II{len(words)}I", width, height, *words)


def test_an_image_that_was_packed_by_hand() -> None:
    # 2 zeros, 2 others: +5 is coded as 10, which takes two nibbles, and -2 as 3; 1 zero, no others.
    image = np.array([[0, 0, 5, 3, 0]], np.uint16)
    data = struct.pack("<III", 5, 1, 0x22A13100)
    assert rvl(image) == data
    np.testing.assert_array_equal(decode_rvl(data), image)


@pytest.mark.parametrize(
    "image",
    [
        *(frame.depth for frame in FRAMES),
        np.zeros((480, 640), np.uint16),
        np.full((1, 1), 65535, np.uint16),
        RNG.integers(0, 65536, (37, 53), np.uint16),
        np.tile(np.array([1, 65535, 0], np.uint16), (9, 7)),
    ],
)
def test_what_was_packed_comes_out_again(image: np.ndarray) -> None:
    read = decode_rvl(rvl(image))
    assert read.dtype == np.uint16
    np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_bag_gives_the_depth_that_was_packed(tmp_path: Path, kind: str) -> None:
    speaker, said = Speaker(1 if kind == "bag" else 2), []
    for topic, received_ns, message in camera_messages(speaker, FRAMES, 10**18):
        if topic.endswith("depth_to_color/image_raw"):
            frame = FRAMES[sum("compressedDepth" in one[0] for one in said)]
            data = struct.pack("<iff", 0, 0, 0) + rvl(frame.depth)
            stamp_ns = 10**18 + frame.stamp_ns
            message = speaker.compressed(stamp_ns, message.header.frame_id, "16UC1; compressedDepth rvl", data)
            topic += "/compressedDepth"
        said.append((topic, received_ns, message))
    bag = open_source(write_bag(tmp_path, kind, said))
    assert len(bag) == len(FRAMES)
    for read, frame in zip(bag, FRAMES, strict=True):
        assert (read.depth_scale, read.intrinsics) == (0.001, CAMERA)
        np.testing.assert_array_equal(read.depth, frame.depth)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "has 0 bytes, too few for its header"),
        (bytes(11), "has 11 bytes, too few for its header"),
        (bytes(19), "in RVL has 7 bytes, which is too few for its size"),
        (bytes(40), "states a size of 0x0 pixels; is it damaged"),
        (bytes(12) + struct.pack("<II", 2**31, 2**31), "states a size of 2147483648x2147483648"),
        (bytes(12) + struct.pack("<II", 8192, 8192), "states a size of 8192x8192"),
        (bytes(12) + struct.pack("<II", 4, 3), "damaged after pixel 0 of 4x3"),
        (bytes(12) + struct.pack("<III", 4, 3, 0), "damaged after pixel 0 of 4x3"),  # runs of nothing
        (bytes(12) + struct.pack("<IIII", 4, 3, 2**32 - 1, 2**32 - 1), "after pixel 0"),  # a number without an end
        (bytes(12) + struct.pack("<III", 4, 3, 0x7D100000), "after pixel 7"),  # 13 others, where 5 are left
        (bytes(12) + struct.pack("<III", 4, 3, 0xD1000000), "after pixel 0"),  # 13 zeros
    ],
)
def test_damage_is_told(data: bytes, expected: str) -> None:
    with pytest.raises(SourceError, match=expected):
        depth_image(SPEAKER.compressed(0, "c", "16UC1; compressedDepth rvl", data))


def test_every_cut_is_told() -> None:
    whole = rvl(FRAMES[0].depth[::4, ::4])
    for length in range(8, len(whole) - 4):
        with pytest.raises(SourceError, match="damaged after pixel"):
            decode_rvl(whole[:length])


def test_nothing_is_read_or_written_elsewhere() -> None:
    """Whatever comes, the kernel does what Python does, which minds where arrays end."""
    whole = np.frombuffer(rvl(FRAMES[0].depth[::6, ::6]), np.uint8)[8:]
    for _ in range(60):
        damaged = whole.copy()
        damaged[RNG.integers(0, len(damaged), 3)] = RNG.integers(0, 256, 3)
        words = damaged.view("<u4").astype(np.uint32)
        compiled, plain = np.zeros((2, 540), np.uint16)
        assert _decode(words, compiled) == _decode.py_func(words, plain)
        np.testing.assert_array_equal(compiled, plain)
