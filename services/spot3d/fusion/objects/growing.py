"""Rows that come at the end, at a cost of their own and not of all that there are."""

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

Number = TypeVar("Number", bound=np.generic)


class Growing(Generic[Number]):
    """An array of rows of one shape, held in twice the room that it needs at most."""

    def __init__(self, dtype: DTypeLike, *shape: int) -> None:
        self._held: NDArray[Any] = np.zeros((0, *shape), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def rows(self) -> NDArray[Number]:
        """The rows, (n, *shape): a view, of these rows until some are added or taken away."""
        return self._held[: self._count]

    def extend(self, more: NDArray[Any]) -> None:
        """Add rows at the end, (k, *shape)."""
        count = self._count + len(more)
        if count > len(self._held):
            held = np.empty((max(count, 2 * len(self._held)), *self._held.shape[1:]), self._held.dtype)
            held[: self._count] = self.rows
            self._held = held
        self._held[self._count : count] = more
        self._count = count

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Keep chosen rows alone, in their order; the room of the others is given back."""
        self._held = self._held[: self._count][chosen].copy()
        self._count = len(self._held)
