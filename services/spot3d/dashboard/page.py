"""The page: shows received messages in the panels and the scene, at a bounded rate."""

import logging
import operator
import time
from collections.abc import Collection, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
import viser
from numpy.typing import NDArray

from spot3d.dashboard.camera_flight import fly, overview, place_before
from spot3d.dashboard.link import ROBOTS_MAX, Interest, Link
from spot3d.dashboard.panel import Actions, Panel
from spot3d.dashboard.panel_text import drop_table, health_table, hop_table, summary, waiting_for
from spot3d.dashboard.picture import live_picture
from spot3d.dashboard.robot import Robot
from spot3d.dashboard.saving import map_file, objects_file
from spot3d.dashboard.scene import RobotScene
from spot3d.dashboard.settings import DashboardSettings
from spot3d.drawing.picture import png_bytes
from spot3d_schemas import MapPoints, Message

log = logging.getLogger(__name__)

_QUICK_S, _SLOW_S = 0.2, 0.5
_VIEW_HEIGHT, _RENDER_S = 900, 20.0
_FLIGHTS = 16
"""Most browsers whose view is moved at a time; a flight takes a second, and the page goes on meanwhile."""
_PICTURES = 3
"""Most robots whose pictures are shown side by side."""
_HOME_EXTENT_M = 1.2
"""Assumed distance of the scene from the camera, before more is known."""


class Page:
    """Shows the messages of the link on one viser server."""

    def __init__(
        self, server: viser.ViserServer, link: Link, settings: DashboardSettings, where: str, always: bool
    ) -> None:
        self._server, self._link, self._settings = server, link, settings
        self._where, self._always = where, always
        self._robots: dict[str, Robot] = {}
        self._scenes: dict[str, RobotScene] = {}
        self._shown: list[Robot] = []
        self._upright: dict[str, bool] = {}
        self._pictured: list[object] = []
        self._quick_s = self._slow_s = 0.0
        self._flights = ThreadPoolExecutor(_FLIGHTS, "flight")
        self._panel = Panel(server.gui, Actions(self._choose, self._look, self._save, self._reset))
        server.scene.set_up_direction("+z")
        server.scene.world_axes.visible = False
        server.on_client_connect(self._look)

    def close(self) -> None:
        """Wait until no browser's view is being moved."""
        self._flights.shutdown(cancel_futures=True)

    def step(self, first: str | None = None) -> None:
        """Process the received messages, and show what is due; call it about twenty times a second."""
        now_s = time.monotonic()
        for name, topic, message in self._link.drain():
            robot = self._robot(name)
            if robot is not None:
                robot.receive(topic, message, now_s)
        alive = self._link.alive
        for name in alive:
            self._make_room(name, alive)
            self._robot(name)
        for robot in self._robots.values():
            robot.present(alive.get(robot.name, frozenset()), now_s)
        chosen = self._panel.robots(sorted(self._robots), first)
        self._shown = [self._robots[name] for name in chosen]
        watched = self._always or bool(self._server.get_clients())
        heat = self._panel.heat_over_picture
        self._link.follow(Interest(frozenset(chosen), images=watched, heat=heat, maps=watched))
        slow = now_s - self._slow_s >= _SLOW_S
        if slow:
            self._slow_s = now_s
            self._tell(now_s)
        if self._panel.paused:
            self._mark()
            return
        if slow or now_s - self._quick_s >= _QUICK_S:
            self._quick_s = now_s
            self._show(slow)

    def _robot(self, name: str) -> Robot | None:
        if name not in self._robots and len(self._robots) < ROBOTS_MAX:
            self._robots[name] = Robot(name, self._settings.points_max)
        return self._robots.get(name)

    def _make_room(self, name: str, alive: Collection[str]) -> None:
        """If this robot is new and the limit is reached, forget the robot that is gone the longest."""
        gone = [robot for robot in self._robots.values() if robot.name not in alive]
        if name in self._robots or len(self._robots) < ROBOTS_MAX or not gone:
            return
        longest = min(gone, key=lambda robot: robot.alive_s).name
        del self._robots[longest]
        self._link.forget(longest)
        self._upright.pop(longest, None)
        scene = self._scenes.pop(longest, None)
        if scene is not None:
            scene.remove()

    def _tell(self, now_s: float) -> None:
        """Update the texts of the panels."""
        panel, shown = self._panel, self._shown
        first = shown[0] if shown else None
        frames_s = None if first is None or first.frame_s is None else now_s - first.frame_s
        waiting = waiting_for(self._link.connected, self._where, sorted(self._robots), first, frames_s)
        if len(self._link.alive) > ROBOTS_MAX:
            waiting += f" {len(self._link.alive)} robots are running; only the first {ROBOTS_MAX} are shown."
        panel.waiting.say(waiting)
        panel.summary.say("  \n".join(summary(robot) for robot in shown))
        titled = len(shown) > 1
        words = [(robot, robot.records.words(robot.alive, now_s, robot.lost, robot.complete)) for robot in shown]
        panel.health.say("".join((f"<b>{robot.name}</b>" if titled else "") + health_table(of) for robot, of in words))
        panel.latency.say("".join(hop_table(robot.hops.statistics()) for robot in shown))
        panel.drops.say("".join(drop_table(robot.records.drops()) for robot in shown))

    def _show(self, slow: bool) -> None:
        """Update the scene, the picture and the table; slow: also points, path and planes."""
        wanted, shown = self._panel.shown, self._shown
        for robot in shown:
            if robot.name not in self._scenes and robot.up() is not None:
                self._scenes[robot.name] = RobotScene(self._server.scene, robot, self._choose)
                self._scenes[robot.name].turn(robot.up())
        names = {robot.name for robot in shown}
        for name, scene in self._scenes.items():
            scene.visible(name in names)
            if name in names:
                # Robots shown together share a world, and are turned alike.
                scene.turn(shown[0].up())
                scene.show_quick(wanted)
                if slow:
                    scene.show_slow(wanted)
        self._look_at_new(shown)
        found = [(robot.name, item) for robot in shown for item in robot.objects_from(wanted.confidence)]
        of = sum(0 if robot.objects is None else len(robot.objects.objects) for robot in shown)
        self._panel.list_objects(found, of, several=len(shown) > 1)
        self._show_picture(shown)

    def _look_at_new(self, shown: Sequence[Robot]) -> None:
        """Show everything in all browsers after a robot was added, or its first objects have turned its world."""
        looks = False
        for robot in shown:
            upright = robot.objects is not None and bool(robot.objects.objects)
            if robot.name in self._scenes and (robot.name not in self._upright or upright > self._upright[robot.name]):
                self._upright[robot.name], looks = upright, True
        if looks:
            for client in self._server.get_clients().values():
                self._flights.submit(self._look, client).add_done_callback(_tell_failure)

    def _mark(self) -> None:
        """Mark the chosen object, and change nothing else on the paused page."""
        for scene in self._scenes.values():
            scene.mark(self._panel.shown.chosen)
        self._panel.mark()

    def _show_picture(self, shown: Sequence[Robot]) -> None:
        seen = [(robot, *robot.shown) for robot in shown if robot.shown is not None][:_PICTURES]
        heat, wanted = self._panel.heat_over_picture, self._panel.shown
        pictured: list[object] = [heat, wanted.boxes, wanted.confidence]
        for robot, preview, _ in seen:
            pictured += (preview, robot.objects)
        if len(pictured) == len(self._pictured) and all(map(operator.is_, pictured, self._pictured)):
            return
        self._pictured = pictured
        pictures = [
            live_picture(
                preview,
                robot.heat_of(preview) if heat else None,
                pose,
                robot.objects_from(wanted.confidence) if wanted.boxes else (),
            )
            for robot, preview, pose in seen
        ]
        self._panel.show_picture(np.vstack(pictures) if pictures else None)

    def _choose(self, client: viser.ClientHandle | None, name: str, number: int) -> None:
        """Mark an object, and fly there in the browser that asked."""
        self._panel.choose(name, number)
        robot, scene = self._robots.get(name), self._scenes.get(name)
        if client is None or robot is None or scene is None or robot.objects is None:
            return
        item = next((item for item in robot.objects.objects if item.id == number), None)
        if item is not None:
            target = scene.R_view_world @ item.centre
            fly(client, place_before(client, target, float(item.size.max())), target)

    def _look(self, client: viser.ClientHandle | None) -> None:
        """Show everything in one browser."""
        scenes = [(robot, self._scenes[robot.name]) for robot in self._shown if robot.name in self._scenes]
        if client is None or not scenes:
            return
        robot, scene = scenes[0]
        middle, extent, ahead = _extent(robot, scene.R_view_world)
        fly(client, overview(client, middle, extent, ahead), middle)

    def _save(self, client: viser.ClientHandle | None, name: str) -> None:
        if client is None or not self._shown:
            return
        robot = self._shown[0]
        if name == "objects.json":
            content = objects_file(robot)
        elif name == "heatmap.ply":
            whole = self._link.ask(robot.name, "fusion/map") if "fusion" in robot.alive else None
            content = map_file(robot, whole if isinstance(whole, MapPoints) else None)
        else:
            width = round(_VIEW_HEIGHT * client.camera.aspect)
            content = png_bytes(client.get_render(_VIEW_HEIGHT, width, timeout=_RENDER_S)[:, :, :3])
        client.send_file_download(f"{robot.name}-{name}", content, save_immediately=True)

    def _reset(self, client: viser.ClientHandle | None) -> None:
        for robot in self._shown:
            answer = self._link.ask(robot.name, "fusion/reset")
            done = isinstance(answer, Message)
            if client is not None:
                text = "fusion did not answer: check that it runs and that this dashboard may reset it (spot3d doctor)"
                if answer is not None:
                    text = "fusion restarts with an empty map" if done else f"fusion refuses: {answer}"
                client.add_notification(robot.name, text, color="green" if done else "red", auto_close_seconds=6.0)


def _tell_failure(flight: Future[None]) -> None:
    error = None if flight.cancelled() else flight.exception()
    if error is not None:
        log.warning("cannot move a browser's view: %s: %s", type(error).__name__, error)


def _extent(robot: Robot, R_view_world: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
    """Middle (3,) and extent of a robot's map, and where its camera looks (3,), in the view's world."""
    pose = np.eye(4) if robot.pose is None else robot.pose.T_world_camera
    ahead = R_view_world @ pose[:3, 2]
    xyz = robot.map.points()[0]
    if len(xyz) < 1000:
        return R_view_world @ (pose[:3, 3] + _HOME_EXTENT_M * pose[:3, 2]), 1.5 * _HOME_EXTENT_M, ahead
    low, high = np.quantile(xyz[:: max(1, len(xyz) // 20_000)] @ R_view_world.T, (0.05, 0.95), axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low)), ahead
