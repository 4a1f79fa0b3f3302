"""Replaces the header of a replayed message: robot, stream and sender of the replay, and the current time."""

import uuid
from typing import Any

import msgpack

from spot3d_schemas.limits import MAX_FIELD_BYTES, MAX_FIELDS, MAX_OBJECTS_VALUES
from spot3d_schemas.wire import map_spans, unpack

_ALIGNMENT = 16


class Labels:
    """Header values for one pass through a recording: this robot, this process, and a new name for each stream."""

    def __init__(self, robot: str, sender: str) -> None:
        self._robot, self._sender = robot, sender
        self._streams: dict[str, str] = {}

    def on(self, payload: bytes, now_ns: int) -> bytes:
        """The message with these labels, sent now. Everything after the header is unchanged.

        The hops of its trace keep their durations, so that lags are those of the recording and of the replay's own
        stages. The header is padded so that the arrays after it stay aligned. Raises ValueError if it is no message.
        """
        view = memoryview(payload)
        spans = map_spans(view, (0, len(view)), MAX_FIELDS, MAX_OBJECTS_VALUES)
        if "header" not in spans:
            raise ValueError("the message has no header")
        start, end = spans["header"]
        header = unpack(view, (start, end), MAX_FIELD_BYTES)
        renamed = self._renamed(header) | _sent_now(header, now_ns)
        if renamed == header:
            return payload
        renamed.pop("pad", None)
        added = len(msgpack.packb({**renamed, "pad": b""})) - (end - start)
        packed = msgpack.packb({**renamed, "pad": bytes(-added % _ALIGNMENT)})
        return b"".join((view[:start], packed, view[end:]))

    def _renamed(self, header: dict[str, Any]) -> dict[str, Any]:
        names: dict[str, Any] = {"robot": self._robot}
        # Messages of version 1.0 have neither.
        if header.get("sender") is not None:
            names["sender"] = self._sender
        if header.get("stream") is not None:
            names["stream"] = self._streams.setdefault(str(header["stream"]), uuid.uuid4().hex[:12])
        return header | names


def _sent_now(header: dict[str, Any], now_ns: int) -> dict[str, Any]:
    """The trace shifted so that its last sending is now, wall clock. Empty if the message has no trace."""
    trace: list[dict[str, Any]] = header.get("trace") or []
    try:
        later_ns = now_ns - trace[-1]["sent_ns"]
        return {"trace": [hop | {name: hop[name] + later_ns for name in ("received_ns", "sent_ns")} for hop in trace]}
    except (TypeError, KeyError, IndexError):
        return {}  # no trace, or one that readers refuse
