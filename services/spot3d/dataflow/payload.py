"""Copies and decodes the bytes of messages, in shared memory or not."""

from collections.abc import Iterator
from typing import TypeVar

import zenoh
from zenoh.handlers import Handler

from spot3d.dataflow.rate_limited_log import printable
from spot3d_schemas import CodecError, Message, decode, refuse_length
from spot3d_schemas.limits import MAX_TEXT

M = TypeVar("M", bound=Message)

_NO_ANSWER = b"Timeout"
"""Zenoh's own error reply to a query that nobody has answered in time."""


def intact_bytes(payload: zenoh.ZBytes) -> bytes | None:
    """A copy of the bytes; None if they were in shared memory that was reclaimed before the copy was done.

    A sender reclaims memory from a reader that shows no sign of life for a tenth of a second, so that a dead reader
    holds none. Memory that is still valid after the copy was valid throughout. Raises CodecError, and copies nothing,
    if there are more bytes than a message may have: shared memory can hold any number.
    """
    refuse_length(len(payload), "payload")
    data = payload.to_bytes()
    shared = payload.as_shm()
    return data if shared is None or shared.is_valid() else None


def decoded(payload: zenoh.ZBytes, expected: type[M]) -> M | None:
    """The message; None if it is invalid or was reclaimed. For onlookers, which no invalid message may end."""
    try:
        data = intact_bytes(payload)
        return None if data is None else decode(data, expected)
    except CodecError:
        return None


def arrived(handler: Handler[zenoh.Sample], expected: type[M]) -> Iterator[M]:
    """The messages that have arrived by now, for onlookers: see `decoded`."""
    while (sample := handler.try_recv()) is not None:
        message = decoded(sample.payload, expected)
        if message is not None:
            yield message


def refusal(reply: zenoh.Reply) -> str:
    """Why a query is refused, in one line for people; empty if it is not, or nobody has answered in time."""
    said = b"" if reply.err is None else reply.err.payload.to_bytes()
    return "" if said == _NO_ANSWER else printable(said[:MAX_TEXT].decode(errors="replace"))
