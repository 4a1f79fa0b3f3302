"""A bin on a workbench with things in it and beside it, seen from above as by a bin-picking robot's camera."""

from spot3d.source.scene.materials import DARK, PALE, PLASTER
from spot3d.source.scene.placement import TABLE_HEIGHT, Arrangement, Placed, Region, arrange
from spot3d.source.scene.shapes import BOX, ROOM, Primitive

HALF_DEPTH, HALF_WIDTH = 0.45, 0.80
BENCH: Region = (0.03 - HALF_DEPTH, HALF_DEPTH - 0.03, -0.65, 0.65)
MIDDLE: Region = (-0.25, 0.25, -0.35, 0.35)
BIN_SHADED: dict[float, Region] = {0.0: (-2.8, 2.8, -2.8, 2.8), TABLE_HEIGHT: BENCH}


def things_about_bin(seed: int) -> list[Placed]:
    """Places 10 things by the seed alone: a bin, six in it, and three beside it."""
    return arrange((seed, 4), 0.02, BENCH, _fill)


def _fill(bench: Arrangement) -> None:
    bin_ = bench.stand("bin", MIDDLE, yaw=(-0.2, 0.2))
    for name in ("tea box", "tin can", "sugar pack", "mug", "puzzle cube", "jar"):
        bench.put_in(name, bin_)
    for name in ("milk carton", "biscuit tin", "bowl"):
        bench.stand(name)


def bin_room() -> list[Primitive]:
    """Walls and furniture in the world: the workbench in the middle of the room."""
    top = Primitive(BOX, (HALF_DEPTH, HALF_WIDTH, 0.02), PALE, (0.0, 0.0, TABLE_HEIGHT - 0.02))
    half = (TABLE_HEIGHT - 0.04) / 2
    legs = [Primitive(BOX, (0.04, 0.04, half), DARK, (x, y, half)) for x in (-0.35, 0.35) for y in (-0.7, 0.7)]
    return [Primitive(ROOM, (3.0, 3.0, 1.35), PLASTER, (0.0, 0.0, 1.35)), top, *legs]
