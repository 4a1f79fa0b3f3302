"""The bridge over mutual TLS between real routers; where nothing crosses, its health says why."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh
from authority import link, make_fleet

from spot3d.bridge.process import run
from spot3d.bridge.settings import BridgeSettings
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session
from spot3d.dataflow.settings import LinkSettings
from spot3d.security.access import AccessSettings, access_control
from spot3d_schemas import Health, decode, key
from waiting import wait_until

LIMIT_S = 60.0
ROBOT = "drone"
REPORTS = 8
HEAT, OBJECTS = key(ROBOT, "heatmap/heat"), key(ROBOT, "fusion/objects")
ACCESS = AccessSettings(robots=("drone", "other-drone"), stations=("ground",))


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_fleet(tmp_path_factory.mktemp("fleet"))


class TwoSides:
    """A drone's router and a ground station's, each with a session beside it, and the last state of the bridge."""

    def __init__(self, fleet: Path) -> None:
        self.fleet, self.states = fleet, list[str]()
        self.drone_at, self.ground_at = free_loopback_endpoint(), free_loopback_endpoint()
        self.air = free_loopback_endpoint().replace("tcp/", "tls/")

    def __enter__(self) -> "TwoSides":
        with ExitStack() as stack:
            stack.enter_context(open_router((self.drone_at,)))
            self.drone = stack.enter_context(open_session(LinkSettings(connect=(self.drone_at,))))
            self.drone.declare_subscriber(key(ROBOT, "bridge/health"), self._hear)
            self._exit = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._exit.close()

    def open_ground(self) -> zenoh.Session:
        """The other side's router, which asks for certificates on the air, and a session of its own host."""
        ours, access = link(self.fleet, "ground"), access_control(ACCESS)
        self._exit.enter_context(open_router((self.ground_at, self.air), link=ours, access=access))
        return self._exit.enter_context(open_session(LinkSettings(connect=(self.ground_at,))))

    def _hear(self, sample: zenoh.Sample) -> None:
        self.states.append(decode(sample.payload.to_bytes(), Health).state)

    @contextmanager
    def bridge(self, certificate: str, folder: Path) -> Iterator[None]:
        """The bridge of the drone with a certificate of the folder, in a thread."""
        stop = threading.Event()
        own = link(folder, certificate, self.drone_at).model_copy(
            update={"robot": ROBOT, "ca": folder / "ca.pem", "health_interval_s": 0.2}
        )
        thread = threading.Thread(target=run, args=(own, BridgeSettings(ground=(self.air,)), stop))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(30)
        assert not thread.is_alive()


def test_what_is_wanted_crosses_both_ways_by_certificate(fleet: Path) -> None:
    """Begun before there is a ground station: its state says so, and is true again when there is one."""
    with TwoSides(fleet) as sides, sides.bridge("drone", fleet):
        wait_until(lambda: bool(sides.states) and "no answer" in sides.states[-1])
        assert f"no messages to {sides.air}" in sides.states[-1]
        ground = sides.open_ground()
        there, here = set[str](), set[str]()
        ground.declare_subscriber(HEAT, lambda sample: there.add(sample.payload.to_string()))
        sides.drone.declare_subscriber(OBJECTS, lambda sample: here.add(sample.payload.to_string()))

        def both_hear() -> bool:
            sides.drone.put(HEAT, "heat")
            ground.put(OBJECTS, "objects")
            return (there, here) == ({"heat"}, {"objects"})

        wait_until(both_hear)
        wait_until(lambda: sides.states[-1] == "")


@pytest.mark.parametrize(
    ("certificate", "folder", "words"),
    [
        # It does not trust the ground's certificate either.
        ("drone", "stranger", "the router's certificate is refused: unable to get local issuer certificate"),
        ("other-drone", ".", "check that this side's certificate has a role there"),
    ],
)
def test_a_bridge_that_is_refused_says_why(fleet: Path, certificate: str, folder: str, words: str) -> None:
    with TwoSides(fleet) as sides:
        ground = sides.open_ground()
        there: list[str] = []
        ground.declare_subscriber("spot3d/**", lambda sample: there.append(str(sample.key_expr)))

        def refused() -> bool:
            sides.drone.put(HEAT, "heat")
            return bool(sides.states) and words in sides.states[-1]

        with sides.bridge(certificate, fleet / folder):
            wait_until(refused)
            told = len(sides.states)
            wait_until(lambda: len(sides.states) >= told + REPORTS)
            assert all(sides.states[told:]), "while nothing crosses it never says that all is well"
        assert not [name for name in there if name.startswith(f"spot3d/{ROBOT}/")]
