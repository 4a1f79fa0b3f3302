"""What the dashboard knows of one robot, and the files that it saves of it."""

import json
import socket
import threading

import numpy as np
import pytest

pytest.importorskip("viser", reason="the dashboard's packages are not installed")

from schemas_samples import BOX, SAMPLES

from spot3d.dashboard.panel_text import drop_table, health_table, summary, waiting_for
from spot3d.dashboard.picture import live_picture
from spot3d.dashboard.process import run
from spot3d.dashboard.robot import Robot
from spot3d.dashboard.saving import map_file, objects_file
from spot3d.dashboard.settings import DashboardSettings
from spot3d.dataflow.settings import LinkSettings
from spot3d.drawing.picture import object_colour
from spot3d_schemas import BRIDGE, STAGES, TOPICS, CameraIntrinsics, Message, Pose, Preview

POSE = SAMPLES["Pose"].model_copy(update={"status": "ok", "reason": ""})


def at(message: Message, stamp_ns: int) -> Message:
    return message.model_copy(update={"header": message.header.model_copy(update={"stamp_ns": stamp_ns})})


def seen(stamp_ns: int, width: int = 80, height: int = 60) -> Preview:
    camera = CameraIntrinsics(fx=70.0, fy=70.0, cx=39.5, cy=29.5, width=width, height=height)
    colour = np.full((height, width, 3), 90, np.uint8)
    return Preview(header=at(SAMPLES["Preview"], stamp_ns).header, intrinsics=camera, colour=colour)


def robot_with(*topics: str) -> Robot:
    robot = Robot("drone", 1000)
    for topic in topics:
        robot.receive(topic, POSE if topic == "pose/pose" else SAMPLES[TOPICS[topic].message.__name__], 1.0)
    return robot


def test_a_preview_waits_for_its_pose() -> None:
    robot = robot_with()
    robot.receive("source/preview", seen(5), 1.0)
    assert robot.shown is None
    robot.receive("pose/pose", at(POSE, 5), 1.1)
    assert robot.shown is not None
    np.testing.assert_array_equal(robot.shown[1], POSE.T_world_camera)
    assert robot.shown[0].intrinsics.cy == pytest.approx(29.5 - 0.03 * 70), "boxes are drawn where things are seen"
    robot.receive("source/preview", seen(6), 2.0)
    robot.receive("fusion/health", SAMPLES["Health"], 3.5)
    assert robot.shown[0].header.stamp_ns == 6
    assert robot.shown[1] is None, "its pose has not come in a second"


@pytest.mark.parametrize("late", [None, 1, 3])
def test_pictures_go_on_while_poses_come_late_or_not_at_all(late: int | None) -> None:
    robot, shown = robot_with(), []
    for count in range(25):  # five a second, as the source sends them
        robot.receive("source/preview", seen(count), 0.2 * count)
        if late is not None and count >= late:
            robot.receive("pose/pose", at(POSE, count - late), 0.2 * count + 0.1)
        if robot.shown is not None:
            shown.append((robot.shown[0].header.stamp_ns, robot.shown[1] is not None))
    assert len({stamp_ns for stamp_ns, _ in shown}) >= 15
    assert all(has_pose == (late is not None) for _, has_pose in shown)


def test_a_lost_pose_is_told_and_not_drawn() -> None:
    robot = robot_with("pose/pose")
    lost = Pose(**{**dict(POSE), "status": "lost", "reason": "too fast", "T_world_camera": np.eye(4)})
    robot.receive("pose/pose", lost, 1.0)
    assert robot.lost == "too fast"
    assert robot.pose is POSE


def test_a_map_of_another_epoch_takes_the_objects_and_the_path_with_it() -> None:
    robot = robot_with("fusion/objects", "fusion/changes")
    robot.receive("pose/pose", POSE, 1.0)
    assert [item.id for item in robot.objects_from(0.5)] == [BOX.id]
    assert robot.objects_from(0.51) == []
    again = SAMPLES["MapChanges"].model_copy(update={"generation": 5, "epoch": SAMPLES["Objects"].epoch})
    robot.receive("fusion/changes", again, 2.0)
    assert robot.objects is not None, "the last objects of a map come before its points, or fusion was started again"
    robot.receive("fusion/changes", again.model_copy(update={"generation": 6, "epoch": "reset"}), 3.0)
    assert (robot.objects, len(robot.trail.segments()), len(robot.map.points()[0])) == (None, 0, 1)


def test_up_is_the_cameras_until_objects_say_better() -> None:
    robot = robot_with()
    assert robot.up() is None
    robot.receive("pose/pose", POSE, 1.0)
    np.testing.assert_array_equal(robot.up(), -POSE.T_world_camera[:3, 1])
    none = SAMPLES["Objects"].model_copy(update={"objects": (), "up": np.array((0.0, 0.0, 1.0))})
    robot.receive("fusion/objects", none, 1.0)
    np.testing.assert_array_equal(robot.up(), -POSE.T_world_camera[:3, 1], "without objects nobody knows better")
    robot.receive("fusion/objects", SAMPLES["Objects"], 1.0)
    np.testing.assert_array_equal(robot.up(), SAMPLES["Objects"].up)
    robot.receive("fusion/objects", none, 2.0)
    np.testing.assert_array_equal(robot.up(), SAMPLES["Objects"].up, "what is known stays")


def test_heat_is_not_laid_over_the_picture_of_another_moment() -> None:
    robot = robot_with()
    assert robot.heat_of(seen(0)) is None
    robot.receive("heatmap/preview", seen(3_000_000_000), 1.0)
    assert robot.heat_of(seen(3_200_000_000)) is robot.heat is not None
    assert robot.heat_of(seen(9_000_000_000)) is None


def test_the_picture_has_the_boxes_where_they_project() -> None:
    item = BOX.model_copy(update={"centre": np.array([0.0, 0.0, 1.0]), "size": np.array([0.4, 0.4, 0.2])})
    picture = live_picture(seen(5), None, np.eye(4), [item])
    assert picture.shape == (480, 640, 3)
    # The nearer face is 0.9 m away: its corners are 0.2 / 0.9 * 70 pixels from the centre, in the picture eight times.
    edge = picture[240 - 20 : 240 + 20, 320 + 116 : 320 + 134].astype(int)
    assert (np.abs(edge - object_colour(item.id)).max(axis=2) < 20).any()
    plain = live_picture(seen(5), None, None, [item])
    assert (plain == plain[0, 0]).all(), "without a pose nothing is drawn"
    hot = seen(5).model_copy(update={"colour": np.full((60, 80, 3), 255, np.uint8)})
    assert live_picture(seen(5), hot, None, [])[0, 0].tolist() != plain[0, 0].tolist()


def test_saved_files_are_those_of_a_run() -> None:
    robot = robot_with("fusion/objects", "fusion/changes")
    saved = json.loads(objects_file(robot))
    assert [item["id"] for item in saved["objects"]] == [BOX.id]
    assert (saved["frame_count"], saved["up"]) == (9, [0, 0, 1])
    assert json.loads(objects_file(robot_with()))["objects"] == []
    assert b"element vertex 1\n" in map_file(robot, None)
    assert b"element vertex 2\n" in map_file(robot, SAMPLES["MapPoints"])


def test_texts_are_told_and_escaped() -> None:
    robot = robot_with("fusion/objects", "fusion/changes", "fusion/health")
    assert summary(robot).startswith("**drone**: 1 object in 9 frames")
    assert "router" in waiting_for(False, "tcp/a:1", [], None, None)
    assert "no robot is connected to the router" in waiting_for(True, "tcp/a:1", [], None, None)
    assert "is gone" in waiting_for(True, "tcp/a:1", ["drone"], robot, None)
    robot.alive = frozenset(("fusion",))
    assert "no source is running" in waiting_for(True, "tcp/a:1", ["drone"], robot, None)
    assert waiting_for(True, "tcp/a:1", ["drone"], robot, 0.1) == ""
    robot.receive("fusion/progress", SAMPLES["Progress"], 1.0)
    assert "not publish `source/preview`" in waiting_for(True, "tcp/a:1", ["drone"], robot, None)
    assert "<b>late" not in drop_table({"fusion": {"<b>late": 3}})
    words = robot.records.words(("fusion",), 1.0, "")
    assert "&lt;" not in health_table(words)


def test_a_run_that_is_complete_waits_for_nothing() -> None:
    robot = robot_with("fusion/objects")
    assert robot.objects is not None
    robot.objects = robot.objects.model_copy(update={"complete": True})
    assert "is complete" in waiting_for(True, "tcp/a:1", ["drone"], robot, 9.0)
    gone = waiting_for(False, "tcp/a:1", ["drone"], robot, 9.0)
    assert "is complete" in gone
    assert "none answers at `tcp/a:1`" in gone
    assert "#868e96" in health_table(robot.records.words((), 9.0, complete=True))


def test_the_panel_says_why_nothing_crosses() -> None:
    robot = robot_with("fusion/health")
    assert ">bridge<" not in health_table(robot.records.words(STAGES, 1.0))
    state = "no messages to tcp/10.0.0.2:7447 for 5 s: no answer"
    cut = SAMPLES["Health"].model_copy(update={"stage": BRIDGE, "state": state, "drops": {"heatmap/heat skipped": 7}})
    robot.receive("bridge/health", cut, 1.0)
    table = health_table(robot.records.words((*STAGES, BRIDGE), 1.0))
    assert f"<b>bridge</b></td><td>{state}</td>" in table
    assert "<b>bridge</b></td><td>heatmap/heat skipped</td>" in drop_table(robot.records.drops())


def test_a_port_that_is_taken_ends_the_dashboard_with_what_is_wrong() -> None:
    told = list[str]()
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        link = LinkSettings(mode="router", listen=(f"tcp/127.0.0.1:{taken.getsockname()[1]}",), connect=())
        with pytest.raises(ConnectionError, match=r"cannot listen at .* the port or socket may be in use"):
            run(link, DashboardSettings(), threading.Event(), on_ready=told.append)
    assert not told, "no address is given of a page that ends at once"
