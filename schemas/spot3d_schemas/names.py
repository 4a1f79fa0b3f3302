"""Names that go into key expressions."""

import re

from spot3d_schemas.limits import MAX_NAME

_CHUNK = re.compile(rf"[^/*$#?@\s\x00-\x1f\x7f]{{1,{MAX_NAME}}}")


def is_name(text: str) -> bool:
    """Whether a text can be one chunk of a Zenoh key expression."""
    return _CHUNK.fullmatch(text) is not None


def checked_name(name: str) -> str:
    """`name` itself where it can be one chunk of a Zenoh key expression; else raises ValueError."""
    if not is_name(name):
        raise ValueError(
            f"{name[:80]!r} cannot be part of a key; give 1 to {MAX_NAME} characters without / * $ # ? @ or spaces"
        )
    return name
