"""The bytes of a message, wherever they lie."""

from collections.abc import Iterator
from typing import TypeVar

import zenoh
from zenoh.handlers import Handler

from spot3d_schemas import CodecError, Message, decode

M = TypeVar("M", bound=Message)


def intact_bytes(payload: zenoh.ZBytes) -> bytes | None:
    """A copy of the bytes; None where they lay in shared memory that was taken back before the copy was done.

    A sender takes memory back from a reader that shows no sign of life for a tenth of a second, so that a dead
    one keeps nothing. What is still valid after the copy was valid all the while.
    """
    data = payload.to_bytes()
    shared = payload.as_shm()
    return data if shared is None or shared.is_valid() else None


def decoded(payload: zenoh.ZBytes, expected: type[M]) -> M | None:
    """The message; None where it is none or was taken back, for who only looks on: nonsense is not to end him."""
    data = intact_bytes(payload)
    try:
        return None if data is None else decode(data, expected)
    except CodecError:
        return None


def arrived(handler: Handler[zenoh.Sample], expected: type[M]) -> Iterator[M]:
    """The messages that have come by now, for who only looks on: see `decoded`."""
    while (sample := handler.try_recv()) is not None:
        message = decoded(sample.payload, expected)
        if message is not None:
            yield message
