"""Reads the vertex positions of a PLY file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot3d.source.errors import SourceError

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
BYTE_ORDER = {"binary_little_endian": "<", "binary_big_endian": ">"}
LONGEST_HEADER = 65_536


def read_ply_points(path: Path) -> NDArray[np.float32]:
    """(n, 3) float32 x, y, z of all vertices of an ASCII or binary file, in which vertices come first.

    Raises SourceError if the file is missing or malformed.
    """
    if not path.is_file():
        raise SourceError(f"{path} is missing")
    with path.open("rb") as stream:
        start = stream.read(LONGEST_HEADER)
        end = start.find(b"end_header\n")
        if not start.startswith(b"ply") or end < 0:
            raise SourceError(f"{path} is not a PLY file")
        form, count, names = _header(path, start[:end].decode("ascii", "replace").splitlines())
        stream.seek(end + len(b"end_header\n"))
        try:
            if form == "ascii":
                rows = np.loadtxt(stream, dtype=np.float64, max_rows=count, ndmin=2)
                columns = [rows[:, list(names).index(axis)] for axis in "xyz"]
            else:
                vertex = np.dtype([(name, BYTE_ORDER[form] + kind) for name, kind in names.items()])
                data = np.frombuffer(stream.read(count * vertex.itemsize), vertex)
                columns = [data[axis] for axis in "xyz"]
        except (KeyError, IndexError, ValueError) as error:
            raise SourceError(f"{path} is malformed: {error}") from error
    xyz = np.stack(columns, axis=1).astype(np.float32)
    if len(xyz) != count:
        raise SourceError(f"{path} is truncated: it has {len(xyz)} of {count} vertices")
    return xyz


def _header(path: Path, lines: list[str]) -> tuple[str, int, dict[str, str]]:
    """Format, number of vertices, and their properties' types by name."""
    form, count, names, element = "", -1, dict[str, str](), ""
    for words in (line.split() for line in lines):
        if words[:1] == ["format"] and len(words) > 1:
            form = words[1]
        elif words[:1] == ["element"] and len(words) == 3:
            if words[1] != "vertex" and count < 0:
                raise SourceError(f"{path}: vertices must be the first element")
            element = words[1]
            count = int(words[2]) if element == "vertex" and words[2].isdigit() else count
        elif words[:1] == ["property"] and element == "vertex":
            if len(words) != 3 or words[1] not in TYPES:
                raise SourceError(f"{path}: cannot read the vertices' {' '.join(words)}")
            names[words[2]] = TYPES[words[1]]
    if count < 0 or not {"x", "y", "z"} <= set(names) or form not in ("ascii", *BYTE_ORDER):
        raise SourceError(f"{path} has no vertices with x, y, z in a known format")
    return form, count, names
