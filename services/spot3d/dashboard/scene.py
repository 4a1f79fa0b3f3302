"""One robot's world in the page's 3D view."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

from spot3d.boxes import CORNERS, EDGES
from spot3d.dashboard.points import heat_colours
from spot3d.dashboard.robot import Robot
from spot3d.dashboard.world import plane_patches, quaternion
from spot3d.drawing.picture import object_colour
from spot3d.trajectory import rotation_to_z
from spot3d_schemas import Object3D, Preview

_POINT_M = 0.006
_CHUNKS_AT_ONCE = 4
"""Most chunks of the map that are sent to the browsers at a time: 0.6 MB each half second."""
_FRUSTUM_M = 0.1
_LABEL_M = 0.02
"""Height of a label above its box."""
_PLANES_S = 2.0
"""Time between updates of the patches of planes."""
_TURN = np.cos(np.radians(0.5))
"""Cosine of the least turn of the world: with smaller ones it would tremble with each update of the objects."""
_PATH_COLOUR = (240, 240, 240)
_PLANE_COLOUR = (70, 130, 230)
_CHOSEN_COLOUR = (255, 255, 255)

_UNIT_EDGES = (CORNERS / 2).astype(np.float32)[EDGES]
"""(12, 2, 3) edges of the unit cube around the origin."""


@dataclass(frozen=True, slots=True)
class Shown:
    """The options of what the page shows."""

    heat: bool = False
    boxes: bool = True
    labels: bool = True
    planes: bool = True
    path: bool = True
    camera: bool = True
    confidence: float = 0.0
    chosen: tuple[str, int] | None = None
    """Robot and number of the object that was clicked."""


OnClick = Callable[[viser.ClientHandle | None, str, int], None]
"""Called with the browser, the robot and the object's number."""


class _BoxNodes:
    """The nodes of one object."""

    def __init__(self, scene: viser.SceneApi, name: str, robot: str, item: Object3D, on_click: OnClick) -> None:
        colour = object_colour(item.id)
        self._item: tuple[Object3D, bool, bool] | None = None
        self._root = scene.add_frame(name, show_axes=False)
        self._faces = scene.add_box(f"{name}/faces", color=colour, opacity=0.18, cast_shadow=False)
        self._edges = scene.add_line_segments(
            f"{name}/edges", _UNIT_EDGES, colour, thickness=2.5, thickness_units="screen"
        )
        self._label = scene.add_label(f"{name}/label", "", anchor="bottom-center", font_screen_scale=0.65)
        self._colour = colour
        self._faces.on_click(lambda event: on_click(event.client, robot, item.id))

    def show(self, item: Object3D, label: bool, chosen: bool, up: NDArray[np.float64]) -> None:
        """Update the nodes, if anything has changed. up: (3,), in the object's world."""
        if self._item == (item, label, chosen):
            return
        self._item = (item, label, chosen)
        size = np.maximum(item.size, 1e-3)
        self._root.position, self._root.wxyz = item.centre, quaternion(item.rotation)
        self._faces.dimensions = tuple(size.tolist())
        self._edges.scale = tuple(size.tolist())
        self._edges.colors = np.array(_CHOSEN_COLOUR if chosen else self._colour, np.uint8)
        self._edges.thickness = 4.0 if chosen else 2.5
        self._faces.opacity = 0.35 if chosen else 0.18
        self._label.text = object_text(item)
        upwards = item.rotation.T @ up
        self._label.position = (np.abs(upwards) @ size / 2 + _LABEL_M) * upwards
        self._label.visible = label

    def mark(self, chosen: bool, up: NDArray[np.float64]) -> None:
        """Mark or unmark the object, with everything else unchanged."""
        if self._item is not None:
            item, label, _ = self._item
            self.show(item, label, chosen, up)

    def remove(self) -> None:
        """Remove the object from the page."""
        self._root.remove()


class RobotScene:
    """The nodes of one robot, below a frame that turns its world so that z is up."""

    def __init__(self, scene: viser.SceneApi, robot: Robot, on_click: OnClick) -> None:
        self._scene, self._robot, self._on_click = scene, robot, on_click
        self._name = f"/{robot.name}"
        self._root = scene.add_frame(self._name, show_axes=False)
        self._up: NDArray[np.float64] | None = None
        self._boxes: dict[int, _BoxNodes] = {}
        self._chunks: dict[int, viser.PointCloudHandle] = {}
        self._coloured_by_heat = False
        self._frustum: viser.CameraFrustumHandle | None = None
        self._frame: Preview | None = None
        self._path: viser.LineSegmentsHandle | None = None
        self._path_corners = 0
        self._patches: list[viser.MeshHandle] = []
        self._planes_due_s = 0.0

    @property
    def R_view_world(self) -> NDArray[np.float64]:
        """Rotation (3, 3) of this robot's world in the view."""
        return np.eye(3) if self._up is None else rotation_to_z(self._up)

    def visible(self, there: bool) -> None:
        """Show the robot, or hide it."""
        if self._root.visible != there:
            self._root.visible = there

    def remove(self) -> None:
        """Remove the robot from the page."""
        self._root.remove()

    def turn(self, up: NDArray[np.float64] | None) -> None:
        """Turn `up` (3,), of this robot's world, upwards in the view, unless it hardly differs from before."""
        if up is None or (self._up is not None and up @ self._up > _TURN):
            return
        self._up = up
        self._root.wxyz = quaternion(rotation_to_z(up))

    def show_quick(self, shown: Shown) -> None:
        """Update what moves with each frame: the camera, and the boxes."""
        self._show_camera(shown)
        self._show_boxes(self._robot.objects_from(shown.confidence) if shown.boxes else (), shown)

    def mark(self, chosen: tuple[str, int] | None) -> None:
        """Mark the chosen object (robot, number) among the boxes, and unmark the others."""
        for number, box in self._boxes.items():
            box.mark(chosen == (self._robot.name, number), self.R_view_world[2])

    def show_slow(self, shown: Shown) -> None:
        """Update what grows: points, path and planes."""
        self._show_points(shown.heat)
        self._show_path(shown.path)
        self._show_planes(shown.planes)

    def _show_camera(self, shown: Shown) -> None:
        latest, pose = self._robot.shown, self._robot.pose
        if latest is None or pose is None or not shown.camera:
            if self._frustum is not None:
                self._frustum.visible = shown.camera
            return
        preview, T_world_camera = latest
        if preview is self._frame:
            return
        self._frame = preview
        camera = preview.intrinsics
        if self._frustum is None:
            self._frustum = self._scene.add_camera_frustum(
                f"{self._name}/camera",
                fov=2 * float(np.arctan2(camera.height / 2, camera.fy)),
                aspect=camera.width / camera.height,
                scale=_FRUSTUM_M,
                thickness=2.0,
                thickness_units="screen",
                color=object_colour(2),
                format="jpeg",
                jpeg_quality=70,
            )
        self._frustum.visible = True
        self._frustum.image = preview.colour
        place = pose.T_world_camera if T_world_camera is None else T_world_camera
        self._frustum.position, self._frustum.wxyz = place[:3, 3], quaternion(place[:3, :3])

    def _show_boxes(self, items: Sequence[Object3D], shown: Shown) -> None:
        known = {item.id: item for item in items}
        for number in self._boxes.keys() - known.keys():
            self._boxes.pop(number).remove()
        for number, item in known.items():
            if number not in self._boxes:
                name = f"{self._name}/objects/{number}"
                self._boxes[number] = _BoxNodes(self._scene, name, self._robot.name, item, self._on_click)
            chosen = shown.chosen == (self._robot.name, number)
            self._boxes[number].show(item, shown.labels, chosen, self.R_view_world[2])

    def _show_points(self, heat: bool) -> None:
        copy = self._robot.map
        if heat != self._coloured_by_heat:
            self._coloured_by_heat = heat
            copy.dirty |= set(range(copy.chunks))
        for number in sorted(copy.dirty)[:_CHUNKS_AT_ONCE]:
            copy.dirty.discard(number)
            xyz, rgb, warmth, _ = copy.chunk(number)
            if not len(xyz):
                old = self._chunks.pop(number, None)
                if old is not None:
                    old.remove()
                continue
            # Half precision is exact to a millimetre within two metres, hence around the chunk's own middle.
            middle = xyz.mean(axis=0)
            self._chunks[number] = self._scene.add_point_cloud(
                f"{self._name}/points/{number}",
                xyz - middle,
                heat_colours(warmth) if heat else rgb,
                point_size=_POINT_M,
                point_shape="square",
                point_shading="flat",
                position=middle,
            )

    def _show_path(self, wanted: bool) -> None:
        segments = self._robot.trail.segments()
        if not wanted or not len(segments):
            if self._path is not None:
                self._path.remove()
                self._path, self._path_corners = None, 0
            return
        if self._path is None:
            name = f"{self._name}/path"
            self._path = self._scene.add_line_segments(
                name, segments, _PATH_COLOUR, thickness=1.5, thickness_units="screen"
            )
        elif len(segments) != self._path_corners:
            self._path.points = segments
        self._path_corners = len(segments)

    def _show_planes(self, wanted: bool) -> None:
        now_s = time.monotonic()
        if wanted and now_s < self._planes_due_s:
            return
        self._planes_due_s = now_s + _PLANES_S if wanted else 0.0
        corners = plane_patches(self._robot.planes, self._robot.map.points()[0]) if wanted else []
        for number in range(len(corners), len(self._patches)):
            self._patches[number].remove()
        del self._patches[len(corners) :]
        for number, four in enumerate(corners):
            if number < len(self._patches):
                self._patches[number].vertices = four
                continue
            patch = self._scene.add_mesh_simple(
                f"{self._name}/planes/{number}",
                four,
                np.array([(0, 1, 2), (0, 2, 3)], np.uint32),
                color=_PLANE_COLOUR,
                opacity=0.3,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            self._patches.append(patch)


def object_text(item: Object3D) -> str:
    """Number, size and confidence of an object: `7  30 x 12 x 8 cm  0.82`."""
    size = " x ".join(f"{100 * edge:.0f}" for edge in sorted(item.size.tolist(), reverse=True))
    return f"{item.id}  {size} cm  {item.confidence:.2f}"
