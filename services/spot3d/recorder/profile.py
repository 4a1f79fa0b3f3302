"""Whether a file is a recording of ours, told without the mcap library."""

import struct
from pathlib import Path

PROFILE = "spot3d"
_HEAD = b"\x89MCAP0\r\n\x01"


def is_our_mcap(path: Path) -> bool:
    """Whether the file is MCAP with our profile in its header; other MCAP files (of ROS 2, say) have another one."""
    try:
        with path.open("rb") as stream:
            head = stream.read(len(_HEAD) + 12 + len(PROFILE))
    except OSError:
        return False
    return head.startswith(_HEAD) and head[len(_HEAD) + 8 :] == struct.pack("<I", len(PROFILE)) + PROFILE.encode()
