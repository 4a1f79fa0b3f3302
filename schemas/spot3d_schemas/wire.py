"""Finds the byte ranges of a msgpack map's values without decoding or copying any of them.

msgpack's own decoder copies every array and builds whatever the bytes describe. With the ranges known first, arrays
stay views, fields of newer versions stay unread, and the limits hold before anything is allocated.
"""

import struct
from typing import Any, NamedTuple

import msgpack

from spot3d_schemas.limits import MAX_NAME

Span = tuple[int, int]
"""Byte range of a value in a message: from, to."""


class _Tag(NamedTuple):
    """Layout of a value, by its first byte."""

    length_bytes: int
    """Bytes of a length field."""
    size: int
    """Bytes of the value up to its children, first byte and length field included, a counted body not."""
    children: int
    """Values inside, not counted by a length field."""
    per_count: int
    """Values inside for each count of the length field; 0: the length field counts bytes of the body."""


def _tags() -> tuple[_Tag | None, ...]:
    """The msgpack format, first byte by first byte (msgpack spec, "Formats")."""
    tags: list[_Tag | None] = [_Tag(0, 1, 0, 0)] * 256
    for n in range(16):
        tags[0x80 + n] = _Tag(0, 1, 2 * n, 2)
        tags[0x90 + n] = _Tag(0, 1, n, 1)
    for n in range(32):
        tags[0xA0 + n] = _Tag(0, 1 + n, 0, 0)
    tags[0xC1] = None
    for first, extra in ((0xC4, 0), (0xC7, 1)):  # bin; ext, which has a type byte
        for i in range(3):
            tags[first + i] = _Tag(2**i, 1 + 2**i + extra, 0, 0)
    for first, sizes in ((0xCA, (4, 8)), (0xCC, (1, 2, 4, 8)), (0xD0, (1, 2, 4, 8)), (0xD4, (2, 3, 5, 9, 17))):
        for i, size in enumerate(sizes):  # float; uint; int; fixext
            tags[first + i] = _Tag(0, 1 + size, 0, 0)
    for i in range(3):
        tags[0xD9 + i] = _Tag(2**i, 1 + 2**i, 0, 0)  # str
    for i in range(2):
        tags[0xDC + i] = _Tag(2 << i, 1 + (2 << i), 0, 1)  # array
        tags[0xDE + i] = _Tag(2 << i, 1 + (2 << i), 0, 2)  # map
    return tuple(tags)


_TAGS = _tags()
_PLAIN = tuple(0 if tag is None or tag.length_bytes or tag.children else tag.size for tag in _TAGS)
"""Bytes of a value whose first byte alone gives its size, as of most values; else 0."""
_CUT_OFF = "the message is truncated"
_TOO_MANY = "contains more values than the limit; send less"
_BIN_TAGS = frozenset((0xC4, 0xC5, 0xC6))
_MAP_TAGS = frozenset((*range(0x80, 0x90), 0xDE, 0xDF))


def end_of(payload: memoryview, start: int, max_values: int) -> tuple[int, int]:
    """Where the value at `start` ends, and how many values it is made of.

    Raises ValueError where it is cut off, or made of more than `max_values`.
    """
    if max_values < 1:
        raise ValueError(_TOO_MANY)
    plain, at, pending, seen = _PLAIN, start, 1, 0
    try:
        while pending:
            first = payload[at]
            if plain[first]:
                at += plain[first]
                seen += 1
                pending -= 1
                continue
            tag = _TAGS[first]
            if tag is None:
                raise ValueError("the message is not msgpack")
            length_bytes, size, children, per_count = tag
            if length_bytes:
                count = int.from_bytes(payload[at + 1 : at + 1 + length_bytes], "big")
                if per_count:
                    children = count * per_count
                else:
                    size += count
            at += size
            seen += 1
            pending += children - 1
            # Only here can the number of pending values grow.
            if seen + pending > max_values:
                raise ValueError(_TOO_MANY)
    except IndexError:
        raise ValueError(_CUT_OFF) from None
    if at > len(payload):
        raise ValueError(_CUT_OFF)
    return at, seen


def map_spans(payload: memoryview, span: Span, max_fields: int, max_values: int) -> dict[str, Span]:
    """The byte ranges of a map's values by their keys.

    Raises ValueError if the bytes of `span` are anything but one whole map of at most `max_fields` different string
    keys and, all in all, `max_values` values.
    """
    start, end = span
    tag = _TAGS[payload[start]] if start < end else None
    if tag is None or payload[start] not in _MAP_TAGS:
        raise ValueError("expected a msgpack map")
    at = start + tag.size
    count = tag.children // 2
    if tag.length_bytes:
        count = int.from_bytes(payload[start + 1 : at], "big")
    if count > max_fields:
        raise ValueError(f"a map of {count} fields exceeds the limit of {max_fields}; send less")
    spans: dict[str, Span] = {}
    for _ in range(count):
        key, key_end = _key(payload, at)
        if key in spans:
            raise ValueError(f"the field {key!r} occurs twice; send it once")
        at, values = end_of(payload, key_end, max_values)
        spans[key] = (key_end, at)
        max_values -= values
    if at != end:
        raise ValueError(f"{end - at} bytes follow the end of the map")
    return spans


def bin_data(payload: memoryview, span: Span) -> memoryview:
    """The bytes of a msgpack bin, as a view. Raises ValueError where the value is something else."""
    start, end = span
    first = payload[start]
    tag = _TAGS[first]
    if first not in _BIN_TAGS or tag is None:
        raise ValueError("data must be of msgpack's type bin")
    return payload[start + tag.size : end]


def bin_header(length: int) -> bytes:
    """The bytes that announce a bin of `length` bytes, always in the 5-byte form."""
    return struct.pack(">BI", 0xC6, length)


def unpack(payload: memoryview, span: Span, max_bytes: int) -> Any:
    """The value at `span`, decoded. Raises ValueError where it is longer than `max_bytes` or not valid."""
    start, end = span
    if end - start > max_bytes:
        raise ValueError(f"is {end - start} bytes long, and the limit is {max_bytes}; send less")
    try:
        return msgpack.unpackb(payload[start:end])
    except (ValueError, OverflowError, msgpack.UnpackException) as error:
        raise ValueError(f"is not valid msgpack ({str(error)[:100] or type(error).__name__})") from None


def _key(payload: memoryview, start: int) -> tuple[str, int]:
    """The string at `start`, and where it ends."""
    first = payload[start] if start < len(payload) else 0
    if 0xA0 <= first <= 0xBF:
        begin = start + 1
        end = begin + (first & 0x1F)
    elif 0xD9 <= first <= 0xDB:
        begin = start + 1 + 2 ** (first - 0xD9)
        end = begin + int.from_bytes(payload[start + 1 : begin], "big")
    else:
        raise ValueError("a map's keys must be strings")
    if end - begin > MAX_NAME:
        raise ValueError(f"a map's keys must have at most {MAX_NAME} bytes")
    try:
        return str(payload[begin:end], "utf-8"), end
    except UnicodeDecodeError:
        raise ValueError("a map's keys must be UTF-8") from None
