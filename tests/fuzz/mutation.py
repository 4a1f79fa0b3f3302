"""Mutates messages where they have structure: values of the msgpack tree, descriptions of arrays, pixels."""

import copy
import math
import random
import struct
from collections.abc import Callable
from typing import Any

import msgpack

Tree = dict[str, Any]

_NUMBERS = (0, 1, -1, 2, 7, 255, 256, 65535, 2**31, 2**53, 2**62, 2**63 - 1, 2**63, 2**64 - 1, -(2**31), -(2**63))
_FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-300, 1e-12, 1e-3, 1e3, 1e9, 1e30, 1e300, math.inf, -math.inf, math.nan)
_TEXTS = ("", "a", "camera", "lost", "ok", "spot3d.Frame", "1.0", "2.0", "\x1b[31m", "é" * 40, "x" * 3000)
_FLOATS_IN_ARRAYS = (math.nan, math.inf, -1e30)
_CELLS = (b"\x00", b"\xff", b"\x00\x80", *(struct.pack("<f", value) for value in _FLOATS_IN_ARRAYS))
_DTYPES = ("uint8", "uint16", "uint32", "int8", "float32", "float64", "object")
_CODES = ("raw", "jpeg", "delta-zlib", "zstd")


class Mutator:
    """Gives a different neighbour of a message at each call; the same ones for the same seed."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)

    def mutated(self, payload: bytes, changes: int = 1) -> bytes:
        """The message with some of its values, or now and then of its bytes, changed."""
        if self._random.random() < 0.1:
            return self._bytes(payload)
        tree: Tree = msgpack.unpackb(payload)
        for _ in range(changes):
            if tree:
                self._change(tree)
        packed: bytes = msgpack.packb(tree)
        return self._bytes(packed) if self._random.random() < 0.05 else packed

    def _change(self, tree: Tree) -> None:
        """Change one value somewhere; arrays of pixels mostly keep their size, so that stages get to see them."""
        parent, at = self._place(tree)
        value = parent[at]
        if isinstance(value, bytes) and self._random.random() < 0.8:
            parent[at] = self._pixels(value)
            return
        self._random.choice(self._ways(parent, at))()

    def _ways(self, parent: Any, at: Any) -> list[Callable[[], None]]:
        value = parent[at]

        def replace() -> None:
            parent[at] = self._other(value)

        def remove() -> None:
            del parent[at]

        def double() -> None:
            if isinstance(parent, list):
                parent.insert(at, copy.deepcopy(value))
            else:
                parent[f"{at}2"] = copy.deepcopy(value)

        def rename() -> None:
            if isinstance(parent, dict):
                parent[self._random.choice(_TEXTS)] = parent.pop(at)
            else:
                parent.reverse()

        return [replace, replace, replace, remove, double, rename]

    def _place(self, tree: Tree) -> tuple[Any, Any]:
        """A random value's container and its key there."""
        parent: Any = tree
        while True:
            keys = list(parent) if isinstance(parent, dict) else list(range(len(parent)))
            at = self._random.choice(keys)
            inner = parent[at]
            if not isinstance(inner, dict | list) or not inner or self._random.random() < 0.15:
                return parent, at
            parent = inner

    def _other(self, value: Any) -> Any:
        pick = self._random.choice
        if self._random.random() < 0.2:  # of another kind
            return pick(
                (None, True, pick(_NUMBERS), pick(_FLOATS), pick(_TEXTS), b"", [], {}, [[]] * 50, msgpack.Timestamp(1))
            )
        if isinstance(value, bool):
            return not value
        if isinstance(value, int):
            return pick((*_NUMBERS, value + 1, value - 1, 2 * value)) if abs(value) < 2**62 else pick(_NUMBERS)
        if isinstance(value, float):
            return pick((*_FLOATS, -value, value * 1.001, value * 1000))
        if isinstance(value, str):
            return pick((*_TEXTS, *_DTYPES, *_CODES, value[:-1], value + value))
        if isinstance(value, list):
            return pick((value[:-1], value * 2, value[::-1], []))
        return pick(({}, [value], None))

    def _pixels(self, data: bytes) -> bytes:
        """The same number of bytes: a stretch of them set to one cell, shifted, or noise."""
        if len(data) < 2:
            return data
        begin = self._random.randrange(len(data))
        end = min(len(data), begin + self._random.choice((1, 4, 100, len(data))))
        kind = self._random.randrange(4)
        if kind == 0:
            filling = self._random.randbytes(end - begin)
        elif kind == 1:
            filling = data[: end - begin]
        else:
            cell = self._random.choice(_CELLS)
            begin -= begin % len(cell)
            filling = (cell * (end - begin))[: end - begin]
        return data[:begin] + filling + data[begin + len(filling) :]

    def _bytes(self, data: bytes) -> bytes:
        """Bytes changed, cut off, put in or moved, wherever they are."""
        changed = bytearray(data)
        first, second = sorted(self._random.randrange(len(changed) + 1) for _ in range(2))
        kind = self._random.randrange(4)
        if kind == 0:
            for _ in range(self._random.choice((1, 2, 16))):
                changed[self._random.randrange(min(len(changed), 400))] = self._random.randrange(256)
            return bytes(changed)
        if kind == 1:
            return bytes(changed[:first])
        if kind == 2:
            return bytes(changed[:first]) + self._random.randbytes(self._random.randrange(50)) + bytes(changed[first:])
        return bytes(changed[:first] + changed[second:] + changed[first:second])
