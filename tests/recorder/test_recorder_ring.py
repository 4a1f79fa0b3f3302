"""Pieces of memory that are taken and given back in turn."""

from collections import deque

import numpy as np

from spot3d.recorder.ring import Ring


def test_pieces_lie_behind_one_another_and_at_the_front_again() -> None:
    ring = Ring(10)
    assert ring.take(11) is None
    assert [ring.take(4), ring.take(4), ring.take(4)] == [0, 4, None]
    ring.give_back()
    assert [ring.take(2), ring.take(4), ring.used] == [8, 0, 10]
    assert ring.take(1) is None, "it is full"
    for _ in range(3):
        ring.give_back()
    assert (ring.used, ring.place(6)) == (0, 0), "an empty one begins at the front"


def test_no_byte_is_taken_twice() -> None:
    rng = np.random.default_rng(0)
    ring, memory, taken = Ring(100), np.zeros(100, int), deque[slice]()
    for _ in range(2000):
        if rng.random() < 0.5:
            size = int(rng.integers(1, 40))
            at = ring.take(size)
            if at is not None:
                taken.append(slice(at, at + size))
                assert at + size <= 100
                assert not memory[taken[-1]].any()
                memory[taken[-1]] = 1
        elif taken:
            ring.give_back()
            memory[taken.popleft()] = 0
        assert ring.used == memory.sum()
