"""The Zenoh configurations load, stay closed to discovery, and join a drone with its ground station."""

import json
import queue
from pathlib import Path

import pytest
import zenoh

from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session, zenoh_config
from spot3d.dataflow.settings import LinkSettings

FOLDER = Path(__file__).parents[2] / "deploy" / "zenoh"
NAMES = ("one-machine", "drone", "ground")
WITH_TLS = tuple(f"{name}-mtls" for name in NAMES)  # see test_deploy_mtls.py


def load(name: str) -> zenoh.Config:
    return zenoh.Config.from_file(str(FOLDER / f"{name}.json5"))


def value(config: zenoh.Config, path: str) -> object:
    return json.loads(config.get_json(path))


def test_every_configuration_is_tested() -> None:
    assert {path.stem for path in FOLDER.glob("*.json5")} == {*NAMES, *WITH_TLS}


@pytest.mark.parametrize("name", [*NAMES, *WITH_TLS])
@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("mode", "router"),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
        ("transport/shared_memory/enabled", False),
        ("transport/link/tx/lease", 2000),
    ],
)
def test_routers_agree_on(name: str, path: str, expected: object) -> None:
    assert value(load(name), path) == expected


@pytest.mark.parametrize("name", [*NAMES, *WITH_TLS])
def test_routers_drop_messages_as_long_as_stages_do(name: str) -> None:
    path = "transport/link/rx/max_message_size"
    assert value(load(name), path) == value(zenoh_config(LinkSettings()), path)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("one-machine", "tcp/127.0.0.1:7447"),
        ("drone", "tcp/127.0.0.1:7447"),
        ("ground", "tcp/0.0.0.0:7447"),
    ],
)
def test_only_the_ground_station_is_open_to_the_network(name: str, expected: str) -> None:
    assert value(load(name), "listen/endpoints") == [expected]


def test_drone_starts_before_the_ground_station_and_joins_it() -> None:
    """A sample crosses from a client of the drone's router to one of the ground's, which starts later."""
    drone_at, ground_at = free_loopback_endpoint(), free_loopback_endpoint()
    drone, ground = load("drone"), load("ground")
    (link,) = value(drone, "connect/endpoints")
    assert link.startswith("tcp/ground-station:7447#")
    drone.insert_json5("listen/endpoints", json.dumps([drone_at]))
    drone.insert_json5("connect/endpoints", json.dumps([link.replace("tcp/ground-station:7447", ground_at)]))
    ground.insert_json5("listen/endpoints", json.dumps([ground_at]))
    matching: queue.SimpleQueue[bool] = queue.SimpleQueue()
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    with zenoh.open(drone), open_session(LinkSettings(connect=(drone_at,))) as sender:
        publisher = sender.declare_publisher("spot3d/drone/pose/pose")
        publisher.declare_matching_listener(lambda status: matching.put(status.matching))
        with zenoh.open(ground), open_session(LinkSettings(connect=(ground_at,))) as receiver:
            receiver.declare_subscriber("spot3d/drone/pose/pose", lambda sample: arrived.put(sample.payload.to_bytes()))
            assert matching.get(timeout=10)
            publisher.put(b"pose")
            assert arrived.get(timeout=10) == b"pose"
