"""The containers' health check: a stage is alive when its Health messages arrive."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
import zenoh

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import Header, Health, encode, key

ROBOT = "drone"


@pytest.fixture(scope="module")
def healthcheck() -> ModuleType:
    path = Path(__file__).parents[2] / "deploy" / "healthcheck.py"
    spec = importlib.util.spec_from_file_location("healthcheck", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def health(stage: str) -> bytes:
    return encode(
        Health(
            header=Header(robot=ROBOT, seq=1, stamp_ns=0, frame_id="camera"),
            stage=stage,
            pid=1,
            uptime_s=1.0,
            received=0,
            published=0,
            drops={},
            events={},
            errors=0,
            last_error="",
            rate_hz=None,
            latency_ms_p50=None,
            latency_ms_p99=None,
            step_ms_p50=None,
            step_ms_p99=None,
            cpu_s=0.1,
            rss_bytes=1,
            threads=1,
        )
    )


@pytest.fixture
def endpoint() -> str:
    return free_loopback_endpoint()


@pytest.fixture
def router(endpoint: str) -> Iterator[zenoh.Session]:
    with open_router((endpoint,)) as session:
        yield session


@pytest.mark.parametrize(
    ("payload", "expected"),
    [(None, False), (health("pose"), True), (health("fusion"), False), (b"nonsense", False)],
    ids=["silent", "alive", "another stage", "nonsense"],
)
def test_a_stage_is_alive_when_it_says_so(
    healthcheck: ModuleType, router: zenoh.Session, endpoint: str, payload: bytes | None, expected: bool
) -> None:
    publisher = router.declare_publisher(key(ROBOT, "pose/health"))
    if payload is not None:

        def answer(status: zenoh.MatchingStatus) -> None:
            if status.matching:
                publisher.put(payload)

        publisher.declare_matching_listener(answer)
    link = LinkSettings(robot=ROBOT, connect=(endpoint,))
    wait_s = 0.3 if payload is None else 10.0
    assert healthcheck.is_alive("pose", link, wait_s) is expected


def test_without_a_router_nobody_is_alive(healthcheck: ModuleType, endpoint: str) -> None:
    link = LinkSettings(robot=ROBOT, connect=(endpoint,))
    assert healthcheck.is_alive("pose", link, 0.3) is False
