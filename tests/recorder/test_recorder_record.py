"""The recorder on a real wire: what it keeps, what it counts, and what is left after kill -9 or on a full disk."""

import logging
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import pytest
import zenoh
from recordings import ROBOT, frame

from spot3d.dataflow.endpoints import declare_publisher
from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.dataflow.settings import LinkSettings
from spot3d.recorder.mcap_contents import McapContents, open_mcap
from spot3d.recorder.packing import FLUSH_S
from spot3d.recorder.record import RECORDER, Recorded, record
from spot3d.settings import Settings, without_settings
from spot3d.source.sequences import open_source
from spot3d_schemas import alive_key, encode
from waiting import wait_until

PERIOD_NS = 33_000_000
LIMIT_S = 60.0
TOPICS = ("source/frame",)
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks at the packing process in /proc")


@pytest.fixture
def endpoint() -> str:
    return free_loopback_endpoint()


@pytest.fixture
def session(endpoint: str) -> Iterator[zenoh.Session]:
    with open_router((endpoint,)) as opened:
        yield opened


def wait_for_recorder(session: zenoh.Session) -> None:
    def there() -> bool:
        return any(reply.ok is not None for reply in session.liveliness().get(alive_key(ROBOT, RECORDER), timeout=5))

    wait_until(there, "the recorder is there")


def send(session: zenoh.Session, seqs: range, heard: Callable[[bytes], bool] | None = None) -> None:
    """Send frames; where `heard` tells of a message whether it has come, each once the one before has."""
    publisher = declare_publisher(session, "source/frame", LinkSettings(delivery="lossless"))
    for seq in seqs:
        payload = encode(frame(seq, PERIOD_NS * seq))
        publisher.put(payload)
        if heard is None:
            time.sleep(0.02)
        else:
            wait_until(partial(heard, payload), f"message {seq} has come")
    publisher.undeclare()


@contextmanager
def recorder_of(
    session: zenoh.Session, endpoint: str, out: Path, lossless: bool = True, within: Sequence[str] = ()
) -> Iterator["subprocess.Popen[str]"]:
    """The recorder as a process of its own, once it is there; it lets senders wait rather than skip, or not.

    within: a command that becomes the recorder, whose command follows. It is killed at last.
    """
    command = [sys.executable, "-m", "spot3d", "record", str(out), "--topics", "source/*", "--connect", endpoint]
    with subprocess.Popen(
        [*within, *command, *(["--lossless"] if lossless else [])],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
        env=without_settings(os.environ),
    ) as recorder:
        try:
            wait_for_recorder(session)
            yield recorder
        finally:
            recorder.kill()


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (("drone", "pose"), f"no stage of robot {ROBOT} is alive yet; alive here: drone; choose one with --robot"),
        (("drone", RECORDER), f"no stage of robot {ROBOT} is alive yet; no robot is alive here"),
        ((ROBOT, "pose"), ""),
    ],
)
def test_who_records_a_robot_that_is_not_there_is_told_who_is(
    there: tuple[str, str],
    said: str,
    session: zenoh.Session,
    endpoint: str,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    stop = threading.Event()
    settings = Settings(link=LinkSettings(connect=(endpoint,)))
    thread = threading.Thread(target=record, args=(settings, tmp_path / "flight.mcap", TOPICS, stop))
    with caplog.at_level(logging.INFO), session.liveliness().declare_token(alive_key(*there)):
        thread.start()
        try:
            wait_for_recorder(session)
            wait_until(lambda: said in caplog.messages or not said, "it is told", 20.0)
        finally:
            stop.set()
            thread.join(LIMIT_S)
    assert any("is alive yet" in line for line in caplog.messages) == bool(said)


def test_it_keeps_what_it_hears_and_counts_what_it_does_not(
    session: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    path, stop, done = tmp_path / "flight.mcap", threading.Event(), list[Recorded]()
    settings = Settings(link=LinkSettings(connect=(endpoint,)))
    thread = threading.Thread(target=lambda: done.append(record(settings, path, TOPICS, stop)))
    thread.start()
    try:
        wait_for_recorder(session)
        send(session, range(5))
        with session.declare_publisher(f"spot3d/{ROBOT}/source/frame") as publisher:
            publisher.put(b"nonsense")
        send(session, range(8, 10))
        wait_until(lambda: path.stat().st_size > 7 * 9000, "the last frame is in the file, a second later")
    finally:
        stop.set()
        thread.join(LIMIT_S)
    (recorded,) = done
    assert recorded.messages == {"source/frame": 7}
    assert recorded.skipped == {"source/frame lost on the way": 3, "source/frame refused": 1}
    assert "7 messages of 1 topics" in recorded.summary()
    assert "skipped: 3 source/frame lost on the way, 1 source/frame refused" in recorded.summary()
    contents = open_mcap(path)
    assert contents.complete
    assert contents.metadata["spot3d"]["topics"] == "source/frame"
    assert contents.metadata["skipped"] == {reason: str(count) for reason, count in recorded.skipped.items()}
    assert "[link]" in contents.metadata["settings"]["toml"]
    assert open_source(path).stamps_ns == [PERIOD_NS * seq for seq in (0, 1, 2, 3, 4, 8, 9)]


def packing(recorder: "subprocess.Popen[str]") -> int:
    """The process that packs and writes for a recorder."""
    children = Path(f"/proc/{recorder.pid}/task/{recorder.pid}/children").read_text().split()
    (child,) = (pid for pid in children if b"spot3d.recorder.packing" in Path(f"/proc/{pid}/cmdline").read_bytes())
    return int(child)


def waits(packer: int, payload: bytes) -> bool:
    """Whether a message lies in the memory from which a process packs, which has to be stopped for this."""
    folder = Path(f"/proc/{packer}/fd")
    memory = next(link for link in folder.iterdir() if "spot3d backlog" in str(link.readlink()))
    with memory.open("rb") as file:
        return payload in file.read(4 * 2**20)


def kept(path: Path) -> int:
    """Messages that are in the file."""
    contents: McapContents = open_mcap(path)
    return sum(len(contents.messages(chunk)) for chunk in contents.chunks)


@linux
@pytest.mark.parametrize("killed", ["recorder", "both"])
def test_kill_9_leaves_all_but_the_last_second(
    session: zenoh.Session, endpoint: str, tmp_path: Path, killed: str
) -> None:
    path = tmp_path / "flight.mcap"
    with recorder_of(session, endpoint, path) as recorder:
        send(session, range(20))
        wait_until(lambda: kept(path) == 20, "all are in the file, a second later")
        if killed == "both":
            os.kill(packing(recorder), signal.SIGKILL)
    if killed == "recorder":
        wait_until(lambda: open_mcap(path).complete, "what is left finishes the file")
    assert open_mcap(path).complete == (killed == "recorder")
    sequence = open_source(path)
    assert len(sequence) == 20
    assert (sequence[19].depth == frame(19, 0).depth).all()


@linux
def test_who_writes_may_die_and_it_is_told_in_one_line(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with recorder_of(session, endpoint, path) as recorder:
        send(session, range(5))
        wait_until(lambda: kept(path) == 5, "all are in the file, a second later")
        time.sleep(FLUSH_S)  # in which it has told the recorder so
        os.kill(packing(recorder), signal.SIGKILL)
        said, _ = recorder.communicate(timeout=LIMIT_S)
    assert recorder.returncode == 1
    assert said.count("\n") == 1
    assert "the process that writes it has ended (SIGKILL); it holds the first" in said
    assert ", 5 messages of 1 topics" in said
    assert len(open_source(path)) == 5


@linux
def test_who_writes_may_stand_still_and_nobody_waits_for_it(
    session: zenoh.Session, endpoint: str, tmp_path: Path
) -> None:
    path = tmp_path / "flight.mcap"
    with recorder_of(session, endpoint, path, lossless=False) as recorder:
        packer = packing(recorder)
        os.kill(packer, signal.SIGSTOP)
        send(session, range(40), partial(waits, packer))
        assert kept(path) == 0
        os.kill(packer, signal.SIGCONT)
        recorder.send_signal(signal.SIGINT)
        said, _ = recorder.communicate(timeout=LIMIT_S)
    assert "40 messages of 1 topics" in said
    assert said.endswith("nothing skipped\n")


@linux
def test_ctrl_c_writes_what_was_heard(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    with recorder_of(session, endpoint, path) as recorder:
        packer = packing(recorder)
        os.kill(packer, signal.SIGSTOP)
        send(session, range(30), partial(waits, packer))
        for pid in (packer, recorder.pid):
            os.kill(pid, signal.SIGINT)
        os.kill(packer, signal.SIGCONT)
        said, _ = recorder.communicate(timeout=LIMIT_S)
    assert recorder.returncode == 0
    assert "30 messages of 1 topics" in said
    assert open_mcap(path).complete
    assert len(open_source(path)) == 30


@linux
@pytest.mark.parametrize("beside", [True, False], ids=["beside the stages", "in another session"])
def test_live_it_takes_what_is_left_of_the_processors(
    session: zenoh.Session, endpoint: str, tmp_path: Path, beside: bool
) -> None:
    stage = '"$0" -c "import time; time.sleep(60)" spot3d pose >&- 2>&- & ' if beside else ""
    shell = ("sh", "-c", f'{stage}exec "$@"', sys.executable)
    with recorder_of(session, endpoint, tmp_path / "flight.mcap", lossless=False, within=shell) as recorder:
        try:
            pid = packing(recorder)
            assert os.sched_getscheduler(pid) == os.SCHED_IDLE
            assert os.sched_getscheduler(recorder.pid) == os.SCHED_OTHER, "who hears the messages never waits"
            assert os.getsid(pid) == (recorder.pid if beside else pid)
            group = Path(f"/proc/{pid}/autogroup")
            assert not group.exists() or group.read_text().split()[-1] == ("0" if beside else "19")
            os.kill(pid, signal.SIGSTOP)
            recorder.send_signal(signal.SIGINT)
            ending = "0" if beside else "5"
            wait_until(lambda: not group.exists() or group.read_text().split()[-1] == ending, "somebody waits for it")
            os.kill(pid, signal.SIGCONT)
            recorder.communicate(timeout=LIMIT_S)
        finally:
            with suppress(ProcessLookupError):  # nobody of them is left
                os.killpg(recorder.pid, signal.SIGKILL)
    assert recorder.returncode == 0


@pytest.mark.usefixtures("session")
def test_nothing_is_left_where_it_cannot_listen(endpoint: str, tmp_path: Path) -> None:
    link = LinkSettings(mode="router", listen=(endpoint,), connect=())
    with pytest.raises(ConnectionError, match="cannot listen"):
        record(Settings(link=link), tmp_path / "flight.mcap", TOPICS, threading.Event())
    assert not list(tmp_path.iterdir())


@linux
def test_a_full_disk_is_told_in_one_line(session: zenoh.Session, endpoint: str, tmp_path: Path) -> None:
    path, limit = tmp_path / "flight.mcap", 200_000
    with recorder_of(session, endpoint, path) as recorder:
        resource.prlimit(packing(recorder), resource.RLIMIT_FSIZE, (limit, limit))
        send(session, range(10))
        wait_until(lambda: path.stat().st_size > 90_000, "the first chunk is in the file")
        send(session, range(10, 40))
        said, _ = recorder.communicate(timeout=LIMIT_S)
    assert recorder.returncode == 1
    assert said.count("\n") == 1
    assert "File too large; it holds the first" in said
    assert open_mcap(path).lost_bytes == 0, "of a chunk that had no room nothing is left"
    assert path.stat().st_size <= limit
    assert 10 <= len(open_source(path)) < 40
