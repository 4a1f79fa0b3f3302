"""The table on which, while it is looked at, one thing is taken away, one is moved, and one is put down."""

import numpy as np

from spot3d.source.scene.placement import TABLE_HEIGHT, Arrangement, NoRoomError, Placed, arrange, footprint, separation
from spot3d.source.scene.table import FREE, TABLE_REGION, things_on_table

CHANGE_FRAME = 150
"""The first frame that shows the table changed: after 5 s."""
MOVED_MIN = 0.15
"""Metres by which the moved thing stands elsewhere, at least."""


def things_on_changing_table(seed: int, changed: bool) -> list[Placed | None]:
    """The 12 things of a table and its shelf; once changed, None instead of the taken one, and another at the end.

    What changes is chosen by the seed alone among what stands on the table and carries nothing; where something is put,
    nothing stood before.
    """
    before = things_on_table(seed, cluttered=False)
    if not changed:
        return [*before]
    loose = [number for number, item in enumerate(before) if _is_loose(item, before)]
    names, drawn = {item.thing.name for item in before}, [0, 0]

    def change(table: Arrangement) -> None:
        table.done += before
        drawn[:] = table.rng.choice(loose, 2, replace=False).tolist()
        old = before[drawn[1]]
        new = table.put(old.thing)
        if np.hypot(new.x - old.x, new.y - old.y) < MOVED_MIN:
            raise NoRoomError(old.thing.name)
        table.stand(str(table.rng.choice([name for name in FREE if name not in names])))

    *_, elsewhere, added = arrange((seed, 6), 0.03, TABLE_REGION, change)
    after: list[Placed | None] = [*before, added]
    taken, moved = drawn
    after[taken], after[moved] = None, elsewhere
    return after


def _is_loose(item: Placed, things: list[Placed]) -> bool:
    """Whether a thing stands on the table itself and carries none of the others."""
    outline = footprint(item)
    above = [other for other in things if other.z > item.z]
    return item.z == TABLE_HEIGHT and all(separation(outline, footprint(other)) >= 0 for other in above)
