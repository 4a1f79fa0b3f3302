"""The built-in scenes: solids of a room and its things, and the true boxes of the objects."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spot3d.boxes import Box3D
from spot3d.source.scene.bin import BIN_SHADED, bin_room, things_about_bin
from spot3d.source.scene.changing import CHANGE_FRAME, things_on_changing_table
from spot3d.source.scene.desk import DESK_SHADED, desk_room, things_on_desk
from spot3d.source.scene.levels import ROOM_SHADED, room_of_levels, things_in_room
from spot3d.source.scene.name import DEFAULT_KIND, SceneKind
from spot3d.source.scene.placement import Placed, Region
from spot3d.source.scene.shapes import Solids, pack, placed
from spot3d.source.scene.shelf import SHELF_SHADED, shelf_room, things_on_shelf
from spot3d.source.scene.table import TABLE_SHADED, table_room, things_on_table


@dataclass(frozen=True, slots=True, eq=False)
class TrueBox(Box3D):
    """One object's upright box in the world, its number and its name."""

    id: int
    name: str


@dataclass(frozen=True, slots=True)
class SceneModel:
    """The solids, and the true boxes of the objects. A box's `id` is its instance in `solids.instance`.

    shaded: the upward surfaces that show shadows, by height.
    """

    solids: Solids
    boxes: tuple[TrueBox, ...]
    shaded: dict[float, Region]


def first_frames(kind: SceneKind) -> tuple[int, ...]:
    """The frames at which the scene changes, 0 included. Between two of them `build_scene` gives the same scene."""
    return (0, CHANGE_FRAME) if kind == "changing" else (0,)


def build_scene(seed: int = 0, kind: SceneKind = DEFAULT_KIND, frame: int = 0) -> SceneModel:
    """Room and objects of a seed in a frame. The world's z points up; its origin is on the floor under the table.

    Objects are the things on table, shelves, desk, workbench or floor, 4 to 60 cm large. Furniture, each piece a metre
    long or more, is no object: its instance is 0, as the room's. An object has the same number in all frames.
    """
    things: Sequence[Placed | None]
    if kind in ("desk", "near"):
        primitives, things, shaded = desk_room(), things_on_desk(seed), DESK_SHADED
    elif kind == "shelf":
        primitives, things, shaded = shelf_room(), things_on_shelf(seed), SHELF_SHADED
    elif kind == "bin":
        primitives, things, shaded = bin_room(), things_about_bin(seed), BIN_SHADED
    elif kind == "room":
        primitives, things, shaded = room_of_levels(), things_in_room(seed), ROOM_SHADED
    elif kind == "changing":
        things = things_on_changing_table(seed, frame >= CHANGE_FRAME)
        primitives, shaded = table_room(seed), TABLE_SHADED
    else:
        primitives, things, shaded = table_room(seed), things_on_table(seed, kind == "cluttered"), TABLE_SHADED
    instances = [0] * len(primitives)
    boxes = []
    for number, item in enumerate(things, start=1):
        if item is None:
            continue
        parts = [placed(part, item.yaw, (item.x, item.y, item.z)) for part in item.thing.parts]
        primitives += parts
        instances += [number] * len(parts)
        boxes.append(_true_box(number, item))
    return SceneModel(pack(primitives, instances), tuple(boxes), shaded)


def _true_box(number: int, item: Placed) -> TrueBox:
    c, s = np.cos(item.yaw), np.sin(item.yaw)
    centre = np.array([item.x, item.y, item.z + item.thing.size[2] / 2])
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return TrueBox(centre, np.array(item.thing.size), rotation, number, item.thing.name)
