"""The programs in README.md and docs/ run as they stand, against a router of ours; what they name exists."""

import queue
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import zenoh

from spot3d.dataflow.router import free_loopback_endpoint, open_router
from spot3d.run.earlier_streams import FOLDER as EARLIER
from spot3d.run.growing_files import TRAJECTORY, UPDATES
from spot3d.run.results import RESULTS
from spot3d.run.stage_files import LOGS, SNAPSHOTS
from spot3d.settings import Settings
from spot3d_schemas import (
    CameraIntrinsics,
    Frame,
    Header,
    MapPoints,
    Object3D,
    Objects,
    Pose,
    Proposals,
    Segments,
    decode,
    encode,
    key,
    process_key,
    refuse_encoding,
    token_of,
)
from spot3d_schemas.limits import MAX_SEGMENTS

ROOT = Path(__file__).parents[2]
PAGES = {
    page.relative_to(ROOT): page.read_text() for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
PROGRAMS = [program for text in PAGES.values() for program in re.findall(r"```python\n(.*?)```", text, re.DOTALL)]
HEADER = Header(robot="robot", seq=1, stamp_ns=5, frame_id="camera")


def program_with(text: str) -> str:
    (found,) = [program for program in PROGRAMS if text in program]
    return found


@contextmanager
def running(program: str, endpoint: str) -> Iterator[subprocess.Popen[str]]:
    """The program as a process of its own, at our router instead of the usual one."""
    text = program.replace("tcp/127.0.0.1:7447", endpoint)
    assert text != program
    with subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for_subscriber(session: zenoh.Session, topic: str) -> zenoh.Publisher:
    """A publisher that has a subscriber."""
    publisher = session.declare_publisher(key("robot", topic))
    matching: queue.SimpleQueue[bool] = queue.SimpleQueue()
    publisher.declare_matching_listener(lambda status: matching.put(status.matching))
    if not publisher.matching_status.matching:
        assert matching.get(timeout=20)
    return publisher


@pytest.fixture
def endpoint() -> str:
    return free_loopback_endpoint()


@pytest.fixture
def router(endpoint: str) -> Iterator[zenoh.Session]:
    with open_router((endpoint,)) as session:
        yield session


def test_dashboard_prints_the_objects(router: zenoh.Session, endpoint: str) -> None:
    message = Objects(
        header=HEADER,
        objects=(),
        up=np.array([0.0, 0.0, 1.0]),
        frame_count=12,
        map_points=0,
        map_limit_reached=False,
        complete=False,
    )
    with running(program_with("centre {found.centre}"), endpoint) as process:
        wait_for_subscriber(router, "fusion/objects").put(encode(message))
        assert process.stdout is not None
        assert process.stdout.readline() == "0 objects after 12 frames\n"


def test_a_robot_is_told_where_things_are_from_its_camera_and_their_points(
    router: zenoh.Session, endpoint: str
) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3], T_world_camera[:3, 3] = turn, (1.0, 0.0, 0.0)
    pose = Pose(header=HEADER, T_world_camera=T_world_camera, status="ok", reason="", provider="test")
    cup = Object3D(
        id=7,
        confidence=0.5,
        views=9,
        centre=np.array([1.0, 0.5, 2.0]),
        size=np.array([0.4, 0.1, 0.1]),
        rotation=turn,  # the long side lies along the world's y
        points=5,
        colour=(1, 2, 3),
    )
    fields = {"up": np.array([0.0, 0.0, 1.0]), "map_points": 3, "map_limit_reached": False, "complete": False}
    objects = Objects(header=HEADER, objects=(cup,), frame_count=12, epoch="one", **fields)
    xyz = np.array([[1.0, 0.5, 2.0], [1.0, 0.69, 2.0], [1.19, 0.5, 2.0]], np.float32)
    points = MapPoints(
        header=HEADER,
        xyz=xyz,
        rgb=np.zeros((3, 3), np.uint8),
        heat=np.zeros(3, np.float32),
        frequency=np.ones(3, np.uint32),
        total=3,
    )
    where = key("robot", "fusion/map")
    asked = router.declare_queryable(where, lambda query: query.reply(where, encode(points)))
    with running(program_with("fusion/map"), endpoint) as process:
        wait_for_subscriber(router, "pose/pose").put(encode(pose))
        publisher = wait_for_subscriber(router, "fusion/objects")
        publisher.put(encode(objects))
        assert process.stdout is not None
        assert process.stdout.readline() == "new: [7], gone: []\n"
        assert process.stdout.readline() == "  7: at [0.5 0.  2. ] m from the camera, 2 points\n"
        publisher.put(encode(Objects(header=HEADER, objects=(), frame_count=13, epoch="one", **fields)))
        assert process.stdout.readline() == "new: [], gone: [7]\n"
        publisher.put(encode(Objects(header=HEADER, objects=(cup,), frame_count=1, epoch="two", **fields)))
        assert process.stdout.readline() == "new: [7], gone: []\n"
    asked.undeclare()


def processes(session: zenoh.Session, stage: str) -> list[str | None]:
    """The senders of a stage whose processes are alive."""
    answers = session.liveliness().get(process_key("robot", stage, "*"), timeout=20)
    tokens = [token_of(str(answer.ok.key_expr)) for answer in answers if answer.ok is not None]
    return [token.sender for token in tokens if token is not None]


def frame_of(colour: np.ndarray) -> Frame:
    return Frame(
        header=HEADER.model_copy(update={"sender": "camera"}),
        intrinsics=CameraIntrinsics(fx=5.0, fy=5.0, cx=2.0, cy=1.0, width=6, height=4),
        depth_scale=0.001,
        colour=colour,
        depth=np.ones((4, 6), np.uint16),
        T_world_camera=None,
    )


def test_own_stage_answers_a_frame(router: zenoh.Session, endpoint: str) -> None:
    frame = frame_of(np.zeros((4, 6, 3), np.uint8))
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    router.declare_subscriber(key("robot", "proposals/boxes"), lambda sample: arrived.put(sample.payload.to_bytes()))
    with running(program_with("proposals/boxes"), endpoint):
        wait_for_subscriber(router, "source/frame").put(encode(frame))
        answer = decode(arrived.get(timeout=20), Proposals)
        assert processes(router, "proposals") == [answer.header.sender]
    assert answer.header.sender != frame.header.sender
    assert answer.header.stamp_ns == frame.header.stamp_ns
    assert answer.boxes.tolist() == [[0, 0, 6, 4, 1]]


def test_own_segmenter_labels_a_frame(router: zenoh.Session, endpoint: str) -> None:
    colour = np.zeros((4, 6, 3), np.uint8)
    colour[1:3, 2:5] = 255
    frame = frame_of(colour)
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    router.declare_subscriber(key("robot", "segments/segments"), lambda sample: arrived.put(sample.payload.to_bytes()))
    with running(program_with("segments/segments"), endpoint):
        publisher = wait_for_subscriber(router, "source/frame")
        publisher.put(encode(frame))
        first = decode(arrived.get(timeout=20), Segments)
        publisher.put(encode(frame))
        second = decode(arrived.get(timeout=20), Segments)
        assert processes(router, "segments") == [first.header.sender] == [second.header.sender]
    assert first.header.sender != frame.header.sender
    assert first.header.stamp_ns == frame.header.stamp_ns
    assert [first.header.seq, second.header.seq] == [0, 1]
    assert first.intrinsics == frame.intrinsics
    assert first.labels.tolist() == (colour[..., 0] // 255).tolist()
    assert (first.keyframe, first.heat.tolist(), first.stands_on.tolist()) == (True, [1.0], [-1])


def test_a_segmenter_that_finds_more_than_a_message_holds_goes_on(router: zenoh.Session, endpoint: str) -> None:
    found = "(colour.min(axis=2) > 200)[None], np.ones(1, np.float32)"
    program = program_with("segments/segments")
    assert found in program
    program = program.replace(found, "np.ones((300, *colour.shape[:2]), bool), np.ones(300, np.float32)")
    arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    router.declare_subscriber(key("robot", "segments/segments"), lambda sample: arrived.put(sample.payload.to_bytes()))
    with running(program, endpoint):
        wait_for_subscriber(router, "source/frame").put(encode(frame_of(np.zeros((4, 6, 3), np.uint8))))
        answer = decode(arrived.get(timeout=20), Segments)
    assert len(answer.heat) == MAX_SEGMENTS
    assert answer.labels.max() == MAX_SEGMENTS


def test_own_camera_publishes_frames(router: zenoh.Session, endpoint: str) -> None:
    arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    subscriber = router.declare_subscriber(key("robot", "source/frame"), arrived.put)
    with running(program_with("def capture"), endpoint):
        samples = [arrived.get(timeout=20) for _ in range(2)]
        there = processes(router, "source")
    subscriber.undeclare()
    first, second = (decode(sample.payload.to_bytes(), Frame) for sample in samples)
    refuse_encoding(str(samples[0].encoding), Frame)
    assert there == [first.header.sender], "who follows it is heard at once"
    assert second.header.seq == first.header.seq + 1
    assert second.header.stamp_ns > first.header.stamp_ns
    assert first.depth_noise is not None
    assert (first.header.stream, first.header.sender) == (second.header.stream, second.header.sender)
    assert first.header.stream
    assert first.header.sender


ROS = """
import sys, time, types
import numpy as np
def module(name, **what):
    sys.modules[name] = types.ModuleType(name)
    vars(sys.modules[name]).update(what)
class Synchronizer:
    def __init__(self, inputs, queue_size, slop):
        self.inputs = inputs
    def registerCallback(self, callback):
        self.inputs[0][0].append((callback, [topic for _, _, topic, _ in self.inputs]))
def subscriber(node, kind, topic, qos_profile):
    return node, kind, topic, qos_profile
def spin(node):
    ((callback, topics),) = node
    said = {topics[0]: ((4, 6, 3), "u1"), topics[1]: ((4, 6), "u2")}
    stamp = types.SimpleNamespace(sec=7, nanosec=5)
    images = [types.SimpleNamespace(header=types.SimpleNamespace(stamp=stamp), pixels=np.ones(*said[topic]))
              for topic in topics[:2]]
    k = np.array([5.0, 0, 2, 0, 5.5, 1, 0, 0, 1])
    while True:
        time.sleep(0.05)
        callback(*images, types.SimpleNamespace(k=k, width=6, height=4))
bridge = types.SimpleNamespace(imgmsg_to_cv2=lambda message, encoding: message.pixels)
module("message_filters", Subscriber=subscriber, ApproximateTimeSynchronizer=Synchronizer)
module("rclpy", init=lambda: None, create_node=lambda name: [], spin=spin)
module("rclpy.qos", qos_profile_sensor_data=None)
module("cv_bridge", CvBridge=lambda: bridge)
module("sensor_msgs")
module("sensor_msgs.msg", CameraInfo=None, Image=None)
"""
"""As much of ROS' modules as the node calls; the same messages come again and again."""


def test_a_node_of_ros_publishes_frames(router: zenoh.Session, endpoint: str) -> None:
    arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
    subscriber = router.declare_subscriber(key("robot", "source/frame"), arrived.put)
    with running(ROS + program_with("import rclpy"), endpoint):
        samples = [arrived.get(timeout=20) for _ in range(2)]
    subscriber.undeclare()
    first, second = (decode(sample.payload.to_bytes(), Frame) for sample in samples)
    refuse_encoding(str(samples[0].encoding), Frame)
    assert second.header.seq == first.header.seq + 1
    assert first.header.stamp_ns == 7_000_000_005
    assert (first.header.stream, first.header.sender) == (second.header.stream, second.header.sender)
    assert first.header.stream
    assert first.header.sender
    assert first.intrinsics == CameraIntrinsics(fx=5.0, fy=5.5, cx=2.0, cy=1.0, width=6, height=4)
    assert (first.colour.shape, first.depth.dtype) == ((4, 6, 3), np.uint16)


def test_cores_run_without_processes() -> None:
    program = program_with("weighted_heat")
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert re.fullmatch(r"\d+ boxes: \d+ accepted, \d+ masked, \d+ rejected\n", run.stdout)


def test_every_program_is_tested() -> None:
    """A page that adds one adds its test."""
    tested = ("fusion/objects", "proposals/boxes", "segments/segments", "weighted_heat", "def capture", "import rclpy")
    assert [program for program in PROGRAMS if not any(text in program for text in tested)] == []


def test_files_that_they_name_exist() -> None:
    text = "\n".join(PAGES.values())
    named = set(re.findall(r"\bdeploy/(?:zenoh|settings)/[\w.-]+\w", text))
    assert named
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
    table = PAGES[Path("docs/method.md")].partition("## Where each step")[2].partition("\n## ")[0]
    rows = [line.split("|") for line in table.splitlines() if "`" in line and ".py" in line]
    assert len(rows) > 10
    for row in rows:
        folder = ""
        for path in re.findall(r"`([\w/]+\.py)`", row[3]):
            folder = path.rpartition("/")[0] or folder
            assert (ROOT / "services" / "spot3d" / folder / Path(path).name).is_file(), path


def test_what_a_run_writes_is_in_the_table() -> None:
    table = re.findall(
        r"^\| `([\w.]+)", PAGES[Path("docs/deploying.md")].partition("## Stages one by one")[0], re.MULTILINE
    )
    written = {*RESULTS, TRAJECTORY, UPDATES, EARLIER, LOGS, SNAPSHOTS, "report.json", "settings.toml", "overview.png"}
    assert set(table) == written


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_settings_and_names_of_the_code_that_pages_name_exist(page: Path) -> None:
    sections = {name: field.annotation for name, field in Settings.model_fields.items()}
    code = re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", PAGES[page], flags=re.DOTALL))
    for name in code:
        section, _, setting = name.partition(".")
        known = getattr(sections.get(section), "model_fields", None)
        if known is not None and setting.isidentifier() and setting not in ("py", "ply"):
            assert setting in known, name
    source = "".join(file.read_text() for file in (ROOT / "services").rglob("*.py"))
    private = [name for name in code if re.fullmatch(r"_\w+", name)]
    assert [name for name in private if not re.search(rf"\b{name}\b", source)] == []


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for target, heading in re.findall(r"\]\((?!https?:)([^)#]*)(?:#([^)]*))?\)", PAGES[page]):
        file = (ROOT / page).parent / target if target else ROOT / page
        assert file.exists(), target
        if heading:
            headings = [line.lstrip("# ") for line in file.read_text().splitlines() if line.startswith("#")]
            assert heading in [re.sub(r"[^\w -]", "", line.lower()).replace(" ", "-") for line in headings]
