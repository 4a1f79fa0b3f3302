"""What the keyframes say together: their segments, bounded in number."""

from collections import deque
from collections.abc import Iterator

from spot3d.fusion.keyframes import Keyframe


class ViewConsensus:
    """The keyframes whose segments vote.

    dropped: how many keyframes went because there were more than `limit`, the oldest first.
    """

    def __init__(self, limit: int) -> None:
        self.dropped = 0
        self._keyframes: deque[Keyframe] = deque(maxlen=limit)

    def __len__(self) -> int:
        return len(self._keyframes)

    def __iter__(self) -> Iterator[Keyframe]:
        return iter(self._keyframes)

    def add(self, keyframe: Keyframe) -> None:
        """Take in one keyframe, the latest one."""
        self.dropped += len(self._keyframes) == self._keyframes.maxlen
        self._keyframes.append(keyframe)

    def clear(self) -> None:
        """Forget every keyframe."""
        self._keyframes.clear()
        self.dropped = 0
