"""A bookcase by the wall, with things on its boards and in a crate."""

from spot3d.source.scene.materials import CLOTH, OAK, PLASTER
from spot3d.source.scene.placement import Arrangement, Placed, Region, arrange
from spot3d.source.scene.shapes import BOX, ROOM, Primitive

BOARDS = (0.42, 0.82, 1.22)
DEPTH, HALF_WIDTH, TOP = 0.30, 0.52, 1.62
BOARD_REGION: Region = (0.02 - DEPTH, -0.02, 0.02 - HALF_WIDTH, HALF_WIDTH - 0.02)
SHELF_SHADED: dict[float, Region] = {0.0: (-DEPTH, 2.8, -2.8, 2.8)}
FACING = (-0.3, 0.3)


def things_on_shelf(seed: int) -> list[Placed]:
    """Places 11 things by the seed alone: three below, a crate with two in it and one beside, and four above."""
    return arrange((seed, 3), 0.02, BOARD_REGION, _fill)


def _fill(shelf: Arrangement) -> None:
    low, middle, high = BOARDS
    for name in ("vase", "speaker", "mug"):
        shelf.stand(name, height=low, yaw=FACING)
    crate = shelf.stand("crate", height=middle, yaw=(-0.1, 0.1))
    shelf.put_in("tea box", crate)
    shelf.put_in("tin can", crate)
    shelf.stand("jar", height=middle, yaw=FACING)
    for name in ("ring binder", "flower pot", "bowl", "biscuit tin"):
        shelf.stand(name, height=high, yaw=FACING)


def shelf_room() -> list[Primitive]:
    """Walls and furniture in the world: the bookcase, its back to the wall at x = -0.3, and a sofa beside it."""
    boards = [
        Primitive(BOX, (DEPTH / 2, HALF_WIDTH, 0.01), OAK, (-DEPTH / 2, 0.0, height - 0.01))
        for height in (*BOARDS, TOP)
    ]
    sides = [
        Primitive(BOX, (DEPTH / 2, 0.015, TOP / 2), OAK, (-DEPTH / 2, side * (HALF_WIDTH + 0.015), TOP / 2))
        for side in (-1, 1)
    ]
    back = Primitive(BOX, (0.0075, HALF_WIDTH, TOP / 2), OAK, (0.0075 - DEPTH, 0.0, TOP / 2))
    sofa = Primitive(BOX, (0.45, 0.65, 0.25), CLOTH, (0.15, 1.55, 0.25))
    return [Primitive(ROOM, (2.0, 3.0, 1.35), PLASTER, (2.0 - DEPTH, 0.0, 1.35)), *boards, *sides, back, sofa]
