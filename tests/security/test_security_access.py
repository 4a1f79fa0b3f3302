"""Who reads and says what at a router with certificates and roles: real routers and sessions on loopback."""

import json
import re
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh
from authority import link, make_fleet

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.session import open_session, zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d.security.access import _ANSWERED, AccessSettings, access_control
from spot3d_schemas import alive_key, key

LIMIT_S = 20.0
SETTLED_S = 0.3
"""What is allowed is there within a few milliseconds over loopback."""
ACCESS = AccessSettings(robots=("drone", "other-drone"), stations=("ground",), dashboards=("dashboard",))
POSE = key("drone", "pose/pose")


class Dataflow:
    """A router with roles; behind it, on this host, one who says poses, answers queries and hears what others say."""

    def __init__(self, fleet: Path) -> None:
        self.fleet = fleet
        self.tls = free_loopback_endpoint().replace("tcp/", "tls/")
        self.tcp = free_loopback_endpoint()
        self.heard: list[str] = []
        self.resets: list[str] = []

    @contextmanager
    def running(self) -> Iterator["Dataflow"]:
        with ExitStack() as stack:
            access = access_control(ACCESS)
            router = open_router((self.tls, self.tcp), link=link(self.fleet, "ground"), access=access)
            stack.enter_context(router)
            self.session = stack.enter_context(open_session(LinkSettings(connect=(self.tcp,))))
            self.session.declare_subscriber("spot3d/**", self._hear)
            self.session.declare_queryable(key("drone", "fusion/map"), self._answer, complete=True)
            self.session.declare_queryable(key("drone", "fusion/reset"), self._reset, complete=True)
            self.poses = self.session.declare_publisher(POSE)
            yield self

    def _hear(self, sample: zenoh.Sample) -> None:
        text = sample.payload.to_string()
        if text != "ours":
            self.heard.append(f"{sample.key_expr} {text}")

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, "map")

    def _reset(self, query: zenoh.Query) -> None:
        self.resets.append(str(query.payload))
        self._answer(query)

    def what_gets_through(self, intruder: zenoh.Session) -> dict[str, bool]:
        """What one at the router can read, say and ask for."""
        seen: list[str] = []  # its own messages among them
        everything: list[str] = []
        intruder.declare_subscriber(POSE, lambda sample: seen.append(sample.payload.to_string()))
        intruder.declare_subscriber("**", lambda sample: everything.append(sample.payload.to_string()))
        before, resets = len(self.heard), len(self.resets)
        intruder.put(POSE, "intruder")
        intruder.put(key("other-drone", "pose/pose"), "intruder")
        token = intruder.liveliness().declare_token(alive_key("drone", "pose"))
        time.sleep(SETTLED_S)
        for _ in range(5):
            self.poses.put("ours")
            self.session.put("something/else", "not spot3d's")
        maps = [reply.ok for reply in intruder.get(key("drone", "fusion/map"), timeout=0.5)]
        answers = [reply.ok for reply in intruder.get(key("drone", "fusion/reset"), timeout=0.5)]
        own = str(intruder.info.zid())  # a session answers for itself
        admin = [
            reply.ok for reply in intruder.get("@/**", timeout=0.5) if reply.ok and own not in str(reply.ok.key_expr)
        ]
        time.sleep(SETTLED_S)
        tokens = [str(reply.ok.key_expr) for reply in self.session.liveliness().get("spot3d/*/*/alive", timeout=1.0)]
        token.undeclare()
        said = self.heard[before:]
        return {
            "reads": "ours" in seen,
            "reads what is not spot3d's": "not spot3d's" in everything,
            "says": any(POSE in line for line in said),
            "says as another": any("other-drone" in line for line in said),
            "seems alive": bool(tokens),
            "map": any(maps),
            "reset": any(answers) or len(self.resets) > resets,
            "router's inside": any(admin),
        }


@pytest.fixture(scope="module")
def dataflow(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dataflow]:
    with Dataflow(make_fleet(tmp_path_factory.mktemp("fleet"))).running() as running:
        yield running


@pytest.mark.parametrize(
    ("role", "allowed"),
    [
        ("dashboard", {"reads", "map"}),
        ("drone", {"reads", "says", "seems alive", "map", "reset"}),
        ("other-drone", {"says as another"}),
        ("ground", {"reads", "reads what is not spot3d's", "says", "says as another", "seems alive", "map", "reset"}),
    ],
)
def test_a_role_reads_and_says_what_is_its_own(dataflow: Dataflow, role: str, allowed: set[str]) -> None:
    with open_session(link(dataflow.fleet, role, dataflow.tls)) as session:
        through = dataflow.what_gets_through(session)
    assert {what for what, possible in through.items() if possible} == allowed


def test_a_unix_socket_is_this_host(tmp_path: Path) -> None:
    here = f"unixsock-stream/{tmp_path}/stages"
    for this_host in (True, False):
        access = access_control(ACCESS.model_copy(update={"this_host": this_host}))
        with (
            open_router((here,), access=access),
            open_session(LinkSettings(connect=(here,))) as writer,
            open_session(LinkSettings(connect=(here,))) as reader,
        ):
            heard: list[str] = []
            reader.declare_subscriber(POSE, lambda sample, heard=heard: heard.append(sample.payload.to_string()))
            end_s = time.monotonic() + (LIMIT_S if this_host else SETTLED_S)
            while not heard and time.monotonic() < end_s:
                writer.put(POSE, "ours")
                time.sleep(0.02)
            assert bool(heard) == this_host


def knock(dataflow: Dataflow, name: str | None, folder: Path, *, key_of: str | None = None, wait_ms: int = 700) -> bool:
    """Whether one who checks nothing of his own gets a session at all."""
    given = link(folder, name, dataflow.tls, key=key_of).model_copy(update={"ca": dataflow.fleet / "ca.pem"})
    config = zenoh_config(given)
    config.insert_json5("connect/timeout_ms", str(wait_ms))
    try:
        zenoh.open(config).close()
    except zenoh.ZError:
        return False
    return True


def test_without_a_certificate_of_ours_and_its_key_nobody_gets_a_session(dataflow: Dataflow) -> None:
    fleet = dataflow.fleet
    assert knock(dataflow, "drone", fleet, wait_ms=10_000)
    strangers = [(None, fleet, None), ("drone", fleet / "stranger", None), ("expired", fleet, None)]
    strangers.append(("dashboard", fleet, "drone"))  # another one's key
    with ThreadPoolExecutor(len(strangers)) as pool:
        let_in = [pool.submit(knock, dataflow, name, folder, key_of=key_of) for name, folder, key_of in strangers]
    assert not any(tried.result() for tried in let_in)


def test_unencrypted_at_the_port_for_certificates_nobody_gets_a_session(dataflow: Dataflow) -> None:
    config = zenoh_config(LinkSettings(connect=(dataflow.tls.replace("tls/", "tcp/"),)))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)


def test_nobody_named_means_no_access_control() -> None:
    assert not AccessSettings().enabled
    config = zenoh.Config()
    config.insert_json5("access_control", json.dumps(access_control(ACCESS)))
    assert json.loads(config.get_json("access_control/default_permission")) == "deny"


def test_the_page_names_what_a_dashboard_may_ask() -> None:
    page = (Path(__file__).parents[2] / "docs" / "security.md").read_text()
    (row,) = re.findall(r"^\| dashboard \|(.*)\|$", page, re.MULTILINE)
    asked = {key.removeprefix("spot3d/*/").removeprefix("*/") for key in _ANSWERED if "@adv" not in key}
    assert set(re.findall(r"`([^`]+)`", row.split("|")[-1])) == asked
