"""Arrays to which rows are appended at a cost that does not depend on how many there are."""

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

Number = TypeVar("Number", bound=np.generic)


class Growing(Generic[Number]):
    """An array of rows of one shape, with at most twice the memory that it needs."""

    def __init__(self, dtype: DTypeLike, *shape: int) -> None:
        self._held: NDArray[Any] = np.zeros((0, *shape), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def rows(self) -> NDArray[Number]:
        """The rows, (n, *shape): a view, valid until rows are added or removed."""
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
        """Keep only the chosen rows, in their order; the memory of the others is released."""
        self._held = self._held[: self._count][chosen].copy()
        self._count = len(self._held)
