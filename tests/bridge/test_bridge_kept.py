"""What is kept for late subscribers, the objects, crosses the bridge as it is now, however often the link broke."""

from contextlib import ExitStack
from time import monotonic

import numpy as np

from spot3d.bridge.crossing import Crossing
from spot3d.bridge.settings import BridgeSettings
from spot3d.dataflow.counters import Counters
from spot3d.dataflow.endpoints import declare_publisher, subscribe_newest
from spot3d.dataflow.payload import arrived
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Header, Objects, encode, key
from waiting import wait_until

ROBOT, TOPIC = "kept", "fusion/objects"


def objects(frames: int) -> bytes:
    header = Header(robot=ROBOT, seq=frames, stamp_ns=frames, frame_id="world")
    nothing = {"objects": (), "up": np.array((0.0, -1.0, 0.0)), "map_points": 0, "map_limit_reached": False}
    return encode(Objects(header=header, frame_count=frames, complete=False, **nothing))


def test_objects_from_before_an_outage_are_forgotten_for_those_of_now() -> None:
    """A ground station that was restarted meanwhile has had its last update; the drone showed that of before."""
    drone, ground = free_loopback_endpoint(), free_loopback_endpoint()
    link = LinkSettings(robot=ROBOT, connect=(drone,), shared_memory=False)
    settings = BridgeSettings(ground=(ground,))
    with ExitStack() as stack:
        for endpoint in (drone, ground):
            stack.enter_context(open_router((endpoint,)))
        local = stack.enter_context(open_session(link))
        fusion = stack.enter_context(open_session(link.model_copy(update={"connect": (ground,)})))
        publisher = declare_publisher(fusion, TOPIC, link)

        def heard(crossing: Crossing) -> list[int]:
            """The frame counts that somebody on the drone hears of who has just come."""
            frames = list[int]()
            with ExitStack() as asking, open_session(link) as late:
                ear = subscribe_newest(late, key(ROBOT, TOPIC), 8, asking, kept=True)

                def came() -> bool:
                    crossing.tick()
                    frames.extend(message.frame_count for message in arrived(ear, Objects))
                    return bool(frames)

                wait_until(came, limit_s=20)
                until_s = monotonic() + 0.5
                while monotonic() < until_s:
                    came()
            return frames

        publisher.put(objects(1))
        with Crossing(local, link, settings, Counters("bridge", 0.0)) as first:
            assert heard(first) == [1]
        publisher.put(objects(2))
        with Crossing(local, link, settings, Counters("bridge", 0.0)) as second:
            assert heard(second) == [2]
