"""Things at several levels: on a table, on the floor, on a chest, and on a stool."""

from spot3d.source.scene.materials import DARK, OAK
from spot3d.source.scene.placement import TABLE_HEIGHT, Arrangement, Placed, Region, arrange
from spot3d.source.scene.shapes import BOX, ROOM, SPECKLE, Primitive, Texture

HALF_DEPTH, HALF_WIDTH = 0.40, 0.75
TOP: Region = (0.03 - HALF_DEPTH, HALF_DEPTH - 0.03, 0.03 - HALF_WIDTH, HALF_WIDTH - 0.03)
BESIDE: Region = (-0.30, 0.30, 0.85, 1.50)
BEFORE: Region = (0.50, 1.20, -0.20, 1.00)
CORNER: Region = (0.50, 0.95, -0.75, -0.25)
ROOM_SHADED: dict[float, Region] = {0.0: (-2.8, 2.8, -2.8, 2.8), TABLE_HEIGHT: TOP}


def things_in_room(seed: int) -> list[Placed]:
    """Places 19 things, which depend on the seed alone.

    Nine stand on the table, three on the floor, a chest with four on it, and a stool with one.
    """
    return arrange((seed, 5), 0.03, TOP, _fill)


def _fill(room: Arrangement) -> None:
    for name in ("cereal box", "mug", "speaker", "book", "jar", "bottle", "bowl", "tea box", "dictionary"):
        room.stand(name)
    chest = room.stand("chest", BESIDE, 0.0, (0.0, 0.0))
    x, y, top = chest.thing.size[0] / 2 - 0.02, chest.thing.size[1] / 2 - 0.02, chest.thing.size[2]
    for name in ("sugar pack", "flower pot", "tin can", "tea box"):
        room.stand(name, (chest.x - x, chest.x + x, chest.y - y, chest.y + y), top)
    room.stack("melon", room.stand("stool", CORNER, 0.0))
    for name in ("shoe box", "vase", "biscuit tin"):
        room.stand(name, BEFORE, 0.0)


def room_of_levels() -> list[Primitive]:
    """Walls and furniture in the world: the table in the middle of the room."""
    wall, floor = (0.62, 0.63, 0.60), (0.50, 0.53, 0.54)
    top = Primitive(BOX, (HALF_DEPTH, HALF_WIDTH, 0.02), OAK, (0.0, 0.0, TABLE_HEIGHT - 0.02))
    half = (TABLE_HEIGHT - 0.04) / 2
    legs = [Primitive(BOX, (0.03, 0.03, half), DARK, (x, y, half)) for x in (-0.35, 0.35) for y in (-0.7, 0.7)]
    return [Primitive(ROOM, (3.0, 3.0, 1.35), Texture(SPECKLE, wall, floor, 0.05), (0.0, 0.0, 1.35)), top, *legs]
