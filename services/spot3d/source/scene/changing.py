"""A table that changes while the camera sees it: one thing is removed, one is moved, and one is added."""

import numpy as np

from spot3d.source.scene.placement import TABLE_HEIGHT, Arrangement, NoRoomError, Placed, arrange, footprint, separation
from spot3d.source.scene.table import FREE, TABLE_REGION, things_on_table

CHANGE_FRAME = 150
"""The first frame after the change: after 5 s."""
MOVED_MIN = 0.15
"""Least distance in metres between the old and the new place of the moved thing."""


def things_on_changing_table(seed: int, changed: bool) -> list[Placed | None]:
    """The 12 things of a table and its shelf. Once changed, the removed one is None, and another is appended.

    The seed alone chooses what changes, among things that stand on the table and carry nothing. The moved and the added
    thing are put where nothing stood before.
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
    """Whether a thing stands on the table itself and carries no other thing."""
    outline = footprint(item)
    above = [other for other in things if other.z > item.z]
    return item.z == TABLE_HEIGHT and all(separation(outline, footprint(other)) >= 0 for other in above)
