"""Records what a measurement depends on: settings, data, version, machine."""

import hashlib
from pathlib import Path
from typing import Any

import spot3d
from spot3d.machine import machine
from spot3d.settings import Settings

FILES_READ = 256
BYTES_READ = 65_536


def record(settings: Settings, data: dict[str, str], options: dict[str, Any]) -> dict[str, Any]:
    """The record of a run of tables. data: checksum of each data set by name; options: those of the command line."""
    return {
        "version": spot3d.__version__,
        "machine": machine(),
        "options": options,
        "data": data,
        "settings": settings.model_dump(mode="json"),
    }


def data_checksum(name: str) -> str:
    """A checksum that changes with the data, in bounded time. `name` is a folder, or a built-in scene.

    SHA-256 over the relative path and size of every file, in order, and over the first 64 KiB of at most 256 of them,
    evenly chosen. It ignores dates, so a copy has the same checksum. A built-in scene depends on the version alone.
    """
    folder = Path(name)
    if not folder.is_dir():
        return "built in"
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.relative_to(folder).as_posix()} {path.stat().st_size}\n".encode())
    for path in files[:: max(1, -(-len(files) // FILES_READ))]:
        with path.open("rb") as stream:
            digest.update(stream.read(BYTES_READ))
    return digest.hexdigest()
