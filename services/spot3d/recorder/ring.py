"""A ring allocator, which tracks the used bytes of a memory whose pieces are freed in the order of allocation."""

from collections import deque


class Ring:
    """Allocates pieces of a memory of `size` bytes one after the other, and wraps to the front near the end."""

    def __init__(self, size: int) -> None:
        self.used = 0
        self._size = size
        self._taken: deque[tuple[int, int]] = deque()

    def place(self, size: int) -> int | None:
        """Offset where a piece of `size` bytes would begin now. None if there is no room."""
        if not self._taken:
            return 0 if size <= self._size else None
        begin, end = self._taken[0][0], self._taken[-1][1]
        if end <= begin:  # it has wrapped
            return end if end + size <= begin else None
        if end + size <= self._size:
            return end
        return 0 if size <= begin else None

    def take(self, size: int) -> int | None:
        """Allocate a piece of `size` bytes, at least one. Returns its offset, or None if there is no room."""
        at = self.place(size)
        if at is not None:
            self._taken.append((at, at + size))
            self.used += size
        return at

    def give_back(self) -> None:
        """Free the oldest piece."""
        begin, end = self._taken.popleft()
        self.used -= end - begin
