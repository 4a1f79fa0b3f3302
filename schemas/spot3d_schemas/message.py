"""What all messages of the dataflow share, version 1 (each states its minor version: `VERSION`).

Units: metres, seconds (milliseconds where a name says _ms), integer nanoseconds. The camera frame is optical
(x right, y down, z forward). Arrays are read-only views: of a decoded message into its payload, of a message
made here into the arrays that it was made of, which must not be changed until it is encoded.

Values are checked strictly, once, when a message is made or decoded. Fields that are not listed here are
ignored, not refused: a newer minor version adds fields, and its messages must stay readable; a change that
would mislead an old reader takes a new major version. Since a misspelt field is ignored as well, every field of
1.0 but the header's trace must be given: what is missing is refused. What a minor version has added may be missing,
since older senders do not know it: 1.1 added the header's stream and sender.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import BaseModel, FailFast, Field

from spot3d_schemas.fields import Count, Name, Nanoseconds
from spot3d_schemas.limits import MAX_FIELD_BYTES, MAX_HOPS, MAX_VALUES


class Record(BaseModel, frozen=True, strict=True, extra="ignore"):
    """A frozen, strictly checked set of fields; two are equal when all their values are, arrays included."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(_equal(value, getattr(other, name)) for name, value in self)

    # Not hashable: pydantic would give frozen models a hash that fails on the first array.
    __hash__ = BaseModel.__hash__


class Hop(Record):
    """One stage that handled the frame: when it received it and when it sent its own message, wall clock."""

    stage: Name
    received_ns: Nanoseconds
    sent_ns: Nanoseconds


class Header(Record):
    """The robot and the capture that a message is about. On the wire it holds `schema` and `version` too."""

    robot: Name
    seq: Count
    """Number of the message, counted by its sender."""
    stamp_ns: Nanoseconds
    """Capture time of the frame, by which messages are joined."""
    frame_id: Name
    trace: Annotated[tuple[Hop, ...], FailFast(), Field(strict=False, max_length=MAX_HOPS)] = ()
    stream: Name | None = None
    """The captures that belong together: one session of a camera, one pass through a recording. Since 1.1; None:
    unknown.

    Another stream is another scene: nothing of it is joined, tracked or fused with what was before.
    """
    sender: Name | None = None
    """The process that sent the message; a restarted process has a new one. Since 1.1; None: unknown."""

    def with_hop(self, stage: str, received_ns: int, sent_ns: int) -> "Header":
        """This header with one more hop; beyond the limit the oldest one is dropped."""
        hop = Hop(stage=stage, received_ns=received_ns, sent_ns=sent_ns)
        return self.model_copy(update={"trace": (*self.trace, hop)[-MAX_HOPS:]})


class Message(Record):
    """The base class of all messages."""

    SCHEMA: ClassVar[str]
    VERSION: ClassVar[str] = "1.1"
    MAX_VALUES: ClassVar[int] = MAX_VALUES
    MAX_FIELD_BYTES: ClassVar[int] = MAX_FIELD_BYTES

    header: Header


def _equal(one: object, other: object) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    return not isinstance(other, np.ndarray) and one == other
