"""The messages of the dataflow, version 1 (each states its minor version: `VERSION`).

Units: metres, seconds (milliseconds where a name says _ms), integer nanoseconds. The camera frame is optical
(x right, y down, z forward). Arrays are read-only views: of a decoded message into its payload, of a message
made here into the arrays that it was made of, which must not be changed until it is encoded.

Values are checked strictly, once, when a message is made or decoded. Fields that are not listed here are
ignored, not refused: a newer minor version adds fields, and its messages must stay readable; a change that
would mislead an old reader takes a new major version. Since a misspelt field is ignored as well, every field of
1.0 but the header's trace must be given: what is missing is refused. What a minor version has added may be missing,
since older senders do not know it: 1.1 added the header's stream and sender.
"""

from typing import ClassVar

from spot3d_schemas.header import Header, Record
from spot3d_schemas.limits import (
    MAX_FIELD_BYTES,
    MAX_VALUES,
)


class Message(Record):
    """The base class of all messages."""

    SCHEMA: ClassVar[str]
    VERSION: ClassVar[str] = "1.1"
    MAX_VALUES: ClassVar[int] = MAX_VALUES
    MAX_FIELD_BYTES: ClassVar[int] = MAX_FIELD_BYTES

    header: Header
