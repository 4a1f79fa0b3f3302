"""The configurations with mutual TLS: as those without, but for who comes in and what he may do there."""

import json
import queue
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh
from authority import link, make_fleet

from spot3d.dataflow.router import free_loopback_endpoint
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.security.access import AccessSettings, access_control
from spot3d_schemas import key

FOLDER = Path(__file__).parents[2] / "deploy" / "zenoh"
ROLES = {
    "ground": AccessSettings(robots=("drone",), stations=("ground",), dashboards=("dashboard",)),
    "one-machine": AccessSettings(dashboards=("dashboard",)),
}
POSE, OBJECTS = key("drone", "pose/pose"), key("drone", "fusion/objects")


def load(name: str) -> zenoh.Config:
    return zenoh.Config.from_file(str(FOLDER / f"{name}.json5"))


def everything(config: zenoh.Config) -> dict[str, Any]:
    """All values that a configuration may set here, by their path."""
    paths = ("mode", "connect", "listen", "scouting", "timestamping", "transport", "access_control")
    return {path: json.loads(config.get_json(path)) for path in paths}


@pytest.mark.parametrize("name", ["one-machine", "drone", "ground"])
def test_only_what_tls_needs_differs(name: str) -> None:
    plain, secured = everything(load(name)), everything(load(f"{name}-mtls"))
    endpoints = [*secured["listen"]["endpoints"], *secured["connect"]["endpoints"]]
    assert all(endpoint.startswith(("tcp/127.0.0.1:", "tls/")) for endpoint in endpoints)
    for values in (plain, secured):
        values["listen"]["endpoints"] = values["connect"]["endpoints"] = values["access_control"] = None
        values["transport"]["link"]["tls"] = None
    assert secured == plain


@pytest.mark.parametrize("name", ROLES)
def test_roles_are_those_of_the_settings(name: str) -> None:
    expected = zenoh.Config()
    expected.insert_json5("access_control", json.dumps(access_control(ROLES[name])))
    assert everything(load(f"{name}-mtls"))["access_control"] == everything(expected)["access_control"]


def placed(config: zenoh.Config, fleet: Path, **endpoints: str) -> zenoh.Config:
    """The configuration with its certificates in `fleet` and its endpoints on loopback."""
    tls = json.loads(config.get_json("transport/link/tls"))
    here = {name: str(fleet / Path(value).name) if isinstance(value, str) else value for name, value in tls.items()}
    config.insert_json5("transport/link/tls", json.dumps(here))
    for side, endpoint in endpoints.items():
        config.insert_json5(f"{side}/endpoints", json.dumps(endpoint.split()))
    return config


def test_drone_ground_and_dashboard_meet_by_certificate(tmp_path: Path) -> None:
    """Poses of the drone and objects of the ground reach the dashboard; what it says itself reaches nobody."""
    fleet = make_fleet(tmp_path / "fleet")
    drone_at, ground_at = free_loopback_endpoint(), free_loopback_endpoint()
    outside = free_loopback_endpoint().replace("tcp/", "tls/")
    ground = placed(load("ground-mtls"), fleet, listen=f"{ground_at} {outside}")
    drone = placed(load("drone-mtls"), fleet, listen=drone_at, connect=f"{outside}#so_sndbuf=65536")
    heard: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
    said: list[str] = []
    with (
        zenoh.open(ground),
        zenoh.open(drone),
        open_session(LinkSettings(connect=(drone_at,))) as pose,
        open_session(LinkSettings(connect=(ground_at,))) as fusion,
        open_session(link(fleet, "dashboard", outside)) as dashboard,
    ):
        for session in (pose, fusion):
            session.declare_subscriber("spot3d/**", lambda sample: said.append(sample.payload.to_string()))
        dashboard.declare_subscriber(
            "spot3d/*/*/*", lambda sample: heard.put((str(sample.key_expr), sample.payload.to_string()))
        )
        publishers = [pose.declare_publisher(POSE), fusion.declare_publisher(OBJECTS)]
        deadline_s = time.monotonic() + 20
        while not all(publisher.matching_status.matching for publisher in publishers):
            assert time.monotonic() < deadline_s
            time.sleep(0.02)
        dashboard.put(OBJECTS, "intruder")
        dashboard.put(POSE, "intruder")
        wanted = {(POSE, "true"), (OBJECTS, "true")}
        while wanted:  # a router's own way to the other may be open a moment later than it says
            assert time.monotonic() < deadline_s, f"never heard: {wanted}"
            for publisher in publishers:
                publisher.put("true")
            while not heard.empty():
                wanted.discard(heard.get())
            time.sleep(0.05)
    assert set(said) == {"true"}
