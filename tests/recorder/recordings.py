"""Small recordings, written as the recorder writes them."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spot3d.recorder.mcap_contents import open_mcap
from spot3d.recorder.mcap_writer import McapWriter
from spot3d.recorder.profile import PROFILE
from spot3d.recorder.record import topic_channel
from spot3d_schemas import CameraIntrinsics, Frame, Header, Message, encode

ROBOT = "robot"
START_NS = 1_000_000_000_000
PERIOD_NS = 33_000_000
CAMERA = CameraIntrinsics(fx=50.0, fy=50.0, cx=31.5, cy=23.5, width=64, height=48)


def frame(seq: int, stamp_ns: int, stream: str | None = None) -> Frame:
    """A frame of noise, which does not compress away."""
    rng = np.random.default_rng(seq)
    return Frame(
        header=Header(robot=ROBOT, seq=seq, stamp_ns=stamp_ns, frame_id="camera", stream=stream).with_hop(
            "source", 1, 2
        ),
        intrinsics=CAMERA,
        depth_scale=0.001,
        colour=rng.integers(0, 256, (48, 64, 3), np.uint8),
        depth=rng.integers(500, 2000, (48, 64), np.uint16),
        T_world_camera=np.eye(4),
    )


def damage_second_chunk(path: Path) -> int:
    """Changes a byte in the middle of a recording's second chunk; returns where that chunk begins."""
    whole, second = bytearray(path.read_bytes()), open_mcap(path).chunks[1]
    whole[second.offset + second.length // 2] ^= 0xFF
    path.write_bytes(whole)
    return second.offset


def write_recording(
    path: Path, chunks: Sequence[Sequence[tuple[str, float, Message]]], listed: Sequence[tuple[int, int, str]] = ()
) -> None:
    """A finished recording of messages, each with its topic and seconds after the beginning, chunk by chunk.

    listed: chunk, stamp and stream of each frame, where the recorder has left a list of them.
    """
    writer = McapWriter(path, PROFILE, "test")
    writer.metadata("spot3d", {"robot": ROBOT})
    topics = dict.fromkeys(topic for chunk in chunks for topic, _, _ in chunk)
    channels = {topic: writer.channel(*topic_channel(ROBOT, topic)) for topic in topics}
    for chunk in chunks:
        for topic, seconds, message in chunk:
            log_ns = START_NS + round(1e9 * seconds)
            writer.add(channels[topic], log_ns, log_ns, message.header.seq, encode(message))
        writer.flush()
    if listed:
        writer.metadata("frames", {"topic": "source/frame", "chunk_stamp_ns_stream": json.dumps(listed)})
    writer.close()
