"""The built-in scene: a room with a table and a shelf, things on both, and what is true about them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spot3d.source.scene.placement import SHELF_HEIGHT, TABLE_HEIGHT, Placed, arrange
from spot3d.source.scene.shapes import (
    BOX,
    PICTURE,
    PLAIN,
    ROOM,
    SPECKLE,
    TILES,
    WOOD,
    Colour,
    Primitive,
    Solids,
    Texture,
    pack,
    placed,
)

UP = (0.0, 0.0, 1.0)
OAK: Colour = (0.52, 0.34, 0.18)
PALE: Colour = (0.66, 0.52, 0.34)
DARK: Colour = (0.22, 0.14, 0.09)


@dataclass(frozen=True, slots=True)
class TrueBox:
    """One object's upright box in the world: centre, size (3,) metres, rotation (3, 3), axes as columns."""

    id: int
    name: str
    centre: NDArray[np.float64]
    size: NDArray[np.float64]
    rotation: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SceneModel:
    """The solids, and the true boxes of the objects; box `id` is the instance in `solids.instance`."""

    solids: Solids
    boxes: tuple[TrueBox, ...]


def build_scene(seed: int = 0, cluttered: bool = False) -> SceneModel:
    """Room and objects of a seed; the world's z points up, its origin lies on the floor under the table.

    Objects are the things on table and shelf, 4 to 35 cm large. Table, shelf, cupboard, bench and chest are
    furniture (each more than a metre long) and no objects: their instance is 0, as the room's.
    """
    primitives = room(np.random.default_rng((seed, 99)))
    instances = [0] * len(primitives)
    boxes = []
    for number, item in enumerate(arrange(seed, cluttered), start=1):
        parts = [placed(part, item.yaw, (item.x, item.y, item.z)) for part in item.thing.parts]
        primitives += parts
        instances += [number] * len(parts)
        boxes.append(_true_box(number, item))
    return SceneModel(pack(primitives, instances), tuple(boxes))


def room(rng: np.random.Generator) -> list[Primitive]:
    """Walls and furniture in the world: the table by the wall x = -0.5, the shelf above its rear edge."""
    wall = Texture(TILES, (0.62, 0.63, 0.60), (0.50, 0.53, 0.54), 0.20)
    oak, pale, dark = (
        Texture(WOOD, OAK, DARK, 0.09),
        Texture(WOOD, PALE, OAK, 0.12),
        Texture(WOOD, DARK, OAK, 0.1),
    )
    cloth = Texture(SPECKLE, (0.25, 0.30, 0.38), (0.42, 0.44, 0.46), 0.05)
    inside = (2.35, 2.3, 1.3)
    top = TABLE_HEIGHT - 0.018
    leg_height = TABLE_HEIGHT - 0.036
    pieces = [
        Primitive(ROOM, inside, wall, (-0.5 + inside[0], 0.1, inside[2])),
        Primitive(BOX, (0.4, 0.7, 0.018), pale, (0.0, 0.0, top)),
        Primitive(BOX, (0.14, 0.6, 0.0125), dark, (-0.36, 0.0, SHELF_HEIGHT - 0.0125)),
        Primitive(BOX, (0.22, 0.55, 1.0), oak, (-0.28, 1.62, 1.0)),
        Primitive(BOX, (0.27, 0.65, 0.22), cloth, (-0.15, -1.62, 0.22)),
        Primitive(BOX, (0.60, 0.25, 0.25), dark, (0.15, -2.0, 0.69)),
        Primitive(BOX, (0.9, 0.3, 0.4), pale, (1.3, 1.95, 0.4)),
    ]
    pieces += [
        Primitive(BOX, (0.03, 0.03, leg_height / 2), pale, (0.34 * x, 0.64 * y, leg_height / 2))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    frame = Texture(PLAIN, (0.2, 0.2, 0.2))
    for y in (-0.85, -0.05, 0.6):
        width, height = rng.uniform(0.18, 0.28, 2)
        first, second = rng.uniform(0.1, 0.8, (2, 3))
        print_ = Texture(PICTURE, _colour(first), _colour(second), 0.09)
        z = 1.62 + float(rng.uniform(-0.05, 0.08))
        pieces += [
            Primitive(BOX, (0.012, float(width) + 0.02, float(height) + 0.02), frame, (-0.49, y, z)),
            Primitive(BOX, (0.014, float(width), float(height)), print_, (-0.49, y, z)),
        ]
    return pieces


def _colour(values: NDArray[np.float64]) -> Colour:
    return float(values[0]), float(values[1]), float(values[2])


def _true_box(number: int, item: Placed) -> TrueBox:
    c, s = np.cos(item.yaw), np.sin(item.yaw)
    return TrueBox(
        number,
        item.thing.name,
        np.array([item.x, item.y, item.z + item.thing.size[2] / 2]),
        np.array(item.thing.size),
        np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    )
