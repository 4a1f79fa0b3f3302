"""A table against a wall with a shelf above it, and the things on both."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from spot3d.source.scene.materials import CLOTH, DARK, OAK, PALE, TILED
from spot3d.source.scene.placement import TABLE_HEIGHT, Arrangement, Placed, Region, arrange
from spot3d.source.scene.shapes import BOX, PICTURE, PLAIN, ROOM, Colour, Primitive, Texture

SHELF_HEIGHT = 0.98
TABLE_REGION: Region = (-0.20, 0.37, -0.66, 0.66)
FRONT_REGION: Region = (0.0, 0.37, -0.66, 0.66)
SHELF_REGION: Region = (-0.46, -0.22, -0.56, 0.56)
# Upward surfaces that show shadows, by height.
TABLE_SHADED: dict[float, Region] = {
    0.0: (-0.5, 4.2, -2.2, 2.4),
    TABLE_HEIGHT: (-0.4, 0.4, -0.7, 0.7),
    SHELF_HEIGHT: (-0.5, -0.22, -0.6, 0.6),
}
CURVED = ("bowl", "ball", "melon")
TURNED = ("jar", "flower pot", "cone", "paper roll")
FREE = ("pot", "dictionary", "biscuit tin", "tea box", "paper roll", "ball", "jar")
SMALL = ("puzzle cube", "tin can", "tea box", "mug")
SQUARE = ("milk carton", "tea box", "sugar pack", "tin can", "speaker")
TALL = ("cereal box", "bottle", "speaker")
ON_SHELF = ("jar", "vase", "tin can", "sugar pack", "mug", "puzzle cube")


def things_on_table(seed: int, cluttered: bool) -> list[Placed]:
    """Places 12 things, or 20 to 24 if cluttered, which depend on the seed alone. Two or three are on the shelf.

    There are always a flat one, a stacked one, two that touch, and one hidden behind a tall one.
    """
    fill = partial(_fill, cluttered=cluttered)
    return arrange((seed, int(cluttered)), 0.012 if cluttered else 0.03, TABLE_REGION, fill)


def _fill(table: Arrangement, cluttered: bool) -> None:
    rng = table.rng
    for tall in rng.choice(TALL, 2 if cluttered else 1, replace=False):
        table.hide("mug", table.stand(str(tall), FRONT_REGION))
    for name in ("shoe box", "biscuit tin") if cluttered else ("shoe box",):
        base = table.stand(name)
        top = table.stack(str(rng.choice(SMALL[:3])), base)
        if cluttered and top.thing.name == "tea box":
            table.stack("puzzle cube", top)
    for first, second in rng.permutation(SQUARE)[: 4 if cluttered else 2].reshape(-1, 2):
        table.touch(str(second), table.stand(str(first)))
    table.stand("book")
    table.stand(str(rng.choice(CURVED)))
    table.stand(str(rng.choice(TURNED)))
    for name in rng.choice(FREE, int(rng.integers(2, 5)) if cluttered else 1, replace=False):
        table.stand(str(name))
    for name in rng.choice(ON_SHELF, 3 if cluttered else 2, replace=False):
        table.stand(str(name), SHELF_REGION, SHELF_HEIGHT)


def table_room(seed: int) -> list[Primitive]:
    """Walls and furniture in the world: the table by the wall x = -0.5, the shelf above its rear edge."""
    rng = np.random.default_rng((seed, 99))
    inside = (2.35, 2.3, 1.3)
    top = TABLE_HEIGHT - 0.018
    leg_height = TABLE_HEIGHT - 0.036
    pieces = [
        Primitive(ROOM, inside, TILED, (-0.5 + inside[0], 0.1, inside[2])),
        Primitive(BOX, (0.4, 0.7, 0.018), PALE, (0.0, 0.0, top)),
        Primitive(BOX, (0.14, 0.6, 0.0125), DARK, (-0.36, 0.0, SHELF_HEIGHT - 0.0125)),
        Primitive(BOX, (0.22, 0.55, 1.0), OAK, (-0.28, 1.62, 1.0)),
        Primitive(BOX, (0.27, 0.65, 0.22), CLOTH, (-0.15, -1.62, 0.22)),
        Primitive(BOX, (0.60, 0.25, 0.25), DARK, (0.15, -2.0, 0.69)),
        Primitive(BOX, (0.9, 0.3, 0.4), PALE, (1.3, 1.95, 0.4)),
    ]
    pieces += [
        Primitive(BOX, (0.03, 0.03, leg_height / 2), PALE, (0.34 * x, 0.64 * y, leg_height / 2))
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
