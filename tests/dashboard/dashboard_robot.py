"""A robot whose fusion is real, and whose other stages know the truth of the built-in scene."""

import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import zenoh
from zenoh.handlers import FifoChannel

from spot3d.camera import Intrinsics, invert
from spot3d.dataflow.conversion import segments_message
from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.stopping import StoppedError
from spot3d.frame_segments import FrameSegments
from spot3d.fusion.process import run as run_fusion
from spot3d.fusion.settings import FusionSettings
from spot3d.geometry.planes import transform_plane
from spot3d.source.process import run as run_source
from spot3d.source.scene.placement import TABLE_HEIGHT
from spot3d.source.scene.scene import Scene
from spot3d.source.scene.table import SHELF_HEIGHT
from spot3d.source.settings import SourceSettings
from spot3d_schemas import Frame, Heat, Pose, alive_key, decode, encode, key

CAMERA = Intrinsics(195.0, 195.0, 106.5, 79.5, 214, 160)
RATE_HZ = 6.0
_SURFACES = np.array([[0, 0, 1, -TABLE_HEIGHT], [0, 0, 1, -SHELF_HEIGHT]])
_STAGES = ("pose", "proposals", "heatmap", "segments")


@contextmanager
def robot_at_work(link: LinkSettings, frames: int) -> Iterator[None]:
    """Fusion and a source that plays the built-in scene, live, with poses, heat and segments that are true."""
    # Two of the same: a scene renders for one thread at a time.
    scene, known = (Scene(frames=frames, intrinsics=CAMERA) for _ in range(2))
    stop = threading.Event()
    parts = (
        threading.Thread(target=run_fusion, args=(link, FusionSettings(), stop)),
        threading.Thread(target=_tell_truth, args=(link, known, stop)),
        threading.Thread(
            target=run_source, args=(link, SourceSettings(), scene, RATE_HZ, stop, ("fusion", "segments"))
        ),
    )
    for part in parts:
        part.start()
    try:
        yield
    finally:
        stop.set()
        for part in parts:
            part.join(20)
            assert not part.is_alive()


def _tell_truth(link: LinkSettings, scene: Scene, stop: threading.Event) -> None:
    """Answer each frame as pose, heatmap and segments stages would that never err."""
    try:
        with open_session(link, stop) as session, ExitStack() as stack:
            topics = ("pose/pose", "heatmap/heat", "segments/segments")
            sent = {topic: declare_publisher(session, topic, link) for topic in topics}
            ear = session.declare_subscriber(key(link.robot, "source/frame"), FifoChannel(8))
            for stage in _STAGES:
                token = session.liveliness().declare_token(alive_key(link.robot, stage))
                stack.callback(token.undeclare)
            while not stop.is_set():
                sample: zenoh.Sample | None = ear.handler.try_recv()
                if sample is None:
                    time.sleep(0.01)
                    continue
                frame = decode(sample.payload.to_bytes(), Frame)
                mask = scene.truth(scene.stamps_ns.index(frame.header.stamp_ns)).instance.astype(np.uint8)
                count = int(mask.max())
                now_ns = time.time_ns()
                header = frame.header.with_hop("truth", now_ns, now_ns)
                pose = Pose(
                    header=header, T_world_camera=frame.T_world_camera, status="ok", reason="", provider="truth"
                )
                fields = {name: getattr(frame, name) for name in ("intrinsics", "depth_scale", "colour", "depth")}
                hot = np.where(mask > 0, 255, 0).astype(np.uint8)
                heat = Heat(header=header, **fields, heat=hot, accepted=count, masked=0, rejected=0)
                stands_on = np.array([item.centre[2] > SHELF_HEIGHT for item in scene.boxes[:count]]).astype(np.int8)
                T_camera_world = invert(frame.T_world_camera)
                planes = np.array([transform_plane(plane, T_camera_world) for plane in _SURFACES])
                found = FrameSegments(mask, np.ones(count, np.float32), planes, stands_on, CAMERA)
                for topic, message in zip(topics, (pose, heat, segments_message(header, found)), strict=True):
                    sent[topic].put(encode(message))
    except StoppedError:
        return
