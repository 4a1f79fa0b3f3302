"""The profile of an MCAP file, read without the mcap library."""

import struct
from contextlib import suppress
from pathlib import Path

MAGIC = b"\x89MCAP0\r\n"
PROFILE = "spot3d"
"""Profile of our recordings."""
_HEAD = struct.Struct("<8sBQI")
"""Magic, the header's opcode and length, and the length of the profile, its first field."""
_LONGEST = 100


def mcap_profile(path: Path) -> str | None:
    """The file's profile: `spot3d`, `ros2`, `ros1` or another. None if it is no MCAP file. Raises OSError."""
    with path.open("rb") as stream:
        head = stream.read(_HEAD.size)
        if not head.startswith(MAGIC) or len(head) < _HEAD.size:
            return None
        *_, length = _HEAD.unpack(head)
        return stream.read(min(length, _LONGEST)).decode(errors="replace")


def is_our_mcap(path: Path) -> bool:
    """Whether the file is a recording of ours. False if it cannot be read."""
    with suppress(OSError):
        return mcap_profile(path) == PROFILE
    return False
