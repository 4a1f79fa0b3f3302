"""A free-standing desk in a room, and the things on it."""

from spot3d.source.scene.materials import CLOTH, DARK, OAK, PALE, TILED
from spot3d.source.scene.placement import TABLE_HEIGHT, Arrangement, Placed, Region, arrange
from spot3d.source.scene.shapes import BOX, ROOM, Primitive

HALF_DEPTH, HALF_WIDTH = 0.42, 0.80
DESK_REGION: Region = (0.02 - HALF_DEPTH, HALF_DEPTH - 0.02, 0.02 - HALF_WIDTH, HALF_WIDTH - 0.02)
REAR: Region = (-0.36, -0.02, -0.35, 0.35)
FRONT: Region = (0.05, 0.38, -0.35, 0.40)
DESK_SHADED: dict[float, Region] = {
    0.0: (-2.8, 2.8, -2.8, 2.8),
    TABLE_HEIGHT: (-HALF_DEPTH, HALF_DEPTH, -HALF_WIDTH, HALF_WIDTH),
}
# Yaws that face a person who sits at x > 0.
FACING = (-0.35, 0.35)
LYING_ABOUT = ("stapler", "punch", "letter tray", "paper stack", "telephone", "book")
STANDING_ABOUT = ("ring binder", "mug", "bottle", "tin can", "ball", "melon", "tea box", "flower pot", "pot")


def things_on_desk(seed: int) -> list[Placed]:
    """Places 14 things by the seed alone: screen, keyboard, mouse, laptop, lamp, one stacked, flat and upright ones."""
    return arrange((seed, 2), 0.02, DESK_REGION, _fill)


def _fill(desk: Arrangement) -> None:
    desk.stand("monitor", REAR, yaw=FACING)
    desk.stand("keyboard", FRONT, yaw=FACING)
    desk.stand("mouse", FRONT)
    desk.stand("laptop", yaw=FACING)
    desk.stand("lamp")
    desk.stack("puzzle cube", desk.stand("dictionary"))
    for name in desk.rng.choice(LYING_ABOUT, 4, replace=False):
        desk.stand(str(name))
    for name in desk.rng.choice(STANDING_ABOUT, 3, replace=False):
        desk.stand(str(name))


def desk_room() -> list[Primitive]:
    """Walls and furniture in the world: the desk in the middle, a chair before it, cupboards by the walls."""
    top = TABLE_HEIGHT - 0.0125
    leg = (TABLE_HEIGHT - 0.025) / 2
    desk = [Primitive(BOX, (HALF_DEPTH, HALF_WIDTH, 0.0125), PALE, (0.0, 0.0, top))] + [
        Primitive(BOX, (0.025, 0.025, leg), DARK, (x * (HALF_DEPTH - 0.04), y * (HALF_WIDTH - 0.04), leg))
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    chair = [
        Primitive(BOX, (0.23, 0.23, 0.03), CLOTH, (0.72, 0.1, 0.46)),
        Primitive(BOX, (0.03, 0.22, 0.32), CLOTH, (0.96, 0.1, 0.80)),
        Primitive(BOX, (0.03, 0.03, 0.21), DARK, (0.72, 0.1, 0.22)),
        Primitive(BOX, (0.28, 0.03, 0.02), DARK, (0.72, 0.1, 0.02)),
        Primitive(BOX, (0.03, 0.28, 0.02), DARK, (0.72, 0.1, 0.02)),
    ]
    by_the_walls = [
        Primitive(BOX, (0.22, 0.6, 1.0), OAK, (-2.75, 0.9, 1.0)),
        Primitive(BOX, (0.9, 0.2, 0.42), DARK, (0.3, -2.78, 0.42)),
        Primitive(BOX, (0.55, 0.2, 0.9), OAK, (-0.6, 2.78, 0.9)),
    ]
    return [Primitive(ROOM, (3.0, 3.0, 1.35), TILED, (0.0, 0.0, 1.35)), *desk, *chair, *by_the_walls]
