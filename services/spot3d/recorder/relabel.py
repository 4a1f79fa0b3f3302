"""Other names in the header of a recorded message: a replay is another robot, another stream, another sender."""

import uuid
from typing import Any

import msgpack

from spot3d_schemas.limits import MAX_FIELD_BYTES, MAX_FIELDS, MAX_OBJECTS_VALUES
from spot3d_schemas.wire import map_spans, unpack

_ALIGNMENT = 16


class Labels:
    """The names of one pass through a recording: this robot, this process, and a new name for each stream."""

    def __init__(self, robot: str, sender: str) -> None:
        self._robot, self._sender = robot, sender
        self._streams: dict[str, str] = {}

    def on(self, payload: bytes) -> bytes:
        """The message with these names; all behind its header is as it was. Raises ValueError where it is no message.

        The header is padded so that the arrays behind it stay aligned.
        """
        view = memoryview(payload)
        spans = map_spans(view, (0, len(view)), MAX_FIELDS, MAX_OBJECTS_VALUES)
        if "header" not in spans:
            raise ValueError("the message has no header")
        start, end = spans["header"]
        header = unpack(view, (start, end), MAX_FIELD_BYTES)
        renamed = self._renamed(header)
        if renamed == header:
            return payload
        renamed.pop("pad", None)
        added = len(msgpack.packb({**renamed, "pad": b""})) - (end - start)
        packed = msgpack.packb({**renamed, "pad": bytes(-added % _ALIGNMENT)})
        return b"".join((view[:start], packed, view[end:]))

    def _renamed(self, header: dict[str, Any]) -> dict[str, Any]:
        names: dict[str, Any] = {"robot": self._robot}
        # Messages of 1.0 tell neither.
        if header.get("sender") is not None:
            names["sender"] = self._sender
        if header.get("stream") is not None:
            names["stream"] = self._streams.setdefault(str(header["stream"]), uuid.uuid4().hex[:12])
        return header | names
