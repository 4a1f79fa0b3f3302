"""Stable identities: an object of the last update keeps its number in this one."""

from dataclasses import replace

import numpy as np

from spot3d.boxes import Box3D, iou_matrix_3d
from spot3d.found_object import FoundObject

_REMEMBERED = 1000
"""Most objects whose last box is remembered; beyond, those unseen for longest are forgotten."""
_OVERLAP = 0.1
"""Boxes that overlap less (IoU) are not the same object."""


class Identities:
    """Gives each found object the number of the remembered object that it overlaps most."""

    def __init__(self) -> None:
        self._boxes: dict[int, Box3D] = {}
        self._next = 1

    def assign(self, objects: list[FoundObject]) -> list[FoundObject]:
        """The objects with their numbers, sorted by number."""
        known = list(self._boxes)
        overlap = iou_matrix_3d([item.box for item in objects], [self._boxes[number] for number in known])
        numbers = [0] * len(objects)
        while overlap.size and overlap.max() >= _OVERLAP:
            i, j = np.unravel_index(int(overlap.argmax()), overlap.shape)
            numbers[int(i)] = known[int(j)]
            overlap[i, :], overlap[:, j] = 0, 0
        for row, item in enumerate(objects):
            if numbers[row] == 0:
                numbers[row] = self._next
                self._next += 1
            self._boxes.pop(numbers[row], None)
            self._boxes[numbers[row]] = item.box
        while len(self._boxes) > _REMEMBERED:
            del self._boxes[next(iter(self._boxes))]
        return sorted(
            (replace(item, id=number) for item, number in zip(objects, numbers, strict=True)), key=lambda o: o.id
        )
