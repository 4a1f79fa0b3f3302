"""Which bytes of a piece of memory are taken, where whatever is taken first is given back first."""

from collections import deque


class Ring:
    """Takes pieces of `size` bytes of memory, one behind the other, and begins at the front again near the end."""

    def __init__(self, size: int) -> None:
        self.used = 0
        self._size = size
        self._taken: deque[tuple[int, int]] = deque()

    def place(self, size: int) -> int | None:
        """Where a piece of so many bytes would begin now; None: nowhere."""
        if not self._taken:
            return 0 if size <= self._size else None
        begin, end = self._taken[0][0], self._taken[-1][1]
        if end <= begin:  # it has begun at the front again
            return end if end + size <= begin else None
        if end + size <= self._size:
            return end
        return 0 if size <= begin else None

    def take(self, size: int) -> int | None:
        """Take a piece of so many bytes, at least one; where it begins, or None where there is no room."""
        at = self.place(size)
        if at is not None:
            self._taken.append((at, at + size))
            self.used += size
        return at

    def give_back(self) -> None:
        """Give back the piece that was taken first."""
        begin, end = self._taken.popleft()
        self.used -= end - begin
