"""Describes this process to `spot3d doctor`: versions, memory and disk space, certificate."""

import importlib.metadata
import os
import platform
import shutil
import socket
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

from spot3d import __version__
from spot3d.dataflow.kernel_cache import stage_kernels_missing
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.snapshot_writer import snapshot_path
from spot3d.dataflow.tls import TlsError, own_certificate
from spot3d_schemas import About, Header

_SHARED = Path("/dev/shm")

_kernels_missing = cache(stage_kernels_missing)


def about(header: Header, stage: str, link: LinkSettings) -> About:
    """The `About` message of a stage's process. The clock is read last, as close to the reply as can be."""
    own = None
    with suppress(TlsError):  # reported when the session was opened
        own = own_certificate(link)
    disk = snapshot_disk(link)
    return About(
        header=header,
        stage=stage,
        pid=os.getpid(),
        host=socket.gethostname(),
        spot3d=__version__,
        zenoh=zenoh_version(),
        python=platform.python_version(),
        kernels_missing=_kernels_missing(stage),
        shared_memory_bytes=shared_memory_bytes() if link.shared_memory and link.delivery == "live" else 0,
        disk=str(disk),
        disk_free_bytes=shutil.disk_usage(disk).free,
        certificate_until_ns=None if own is None else int(1e9 * own.until.timestamp()),
        time_ns=time.time_ns(),
    )


def zenoh_version() -> str:
    """The version of Zenoh in this process."""
    return importlib.metadata.version("eclipse-zenoh")


def shared_memory_bytes() -> int:
    """Free bytes of shared memory; 0 if this process may not use it."""
    return shutil.disk_usage(_SHARED).free if os.access(_SHARED, os.W_OK) else 0


def snapshot_disk(link: LinkSettings) -> Path:
    """The folder for snapshots of the map, or the nearest folder above it that exists."""
    folder = snapshot_path(link, "fusion").parent.absolute()
    return next(path for path in (folder, *folder.parents) if path.exists())
