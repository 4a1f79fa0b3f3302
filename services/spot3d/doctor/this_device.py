"""Findings about this device alone."""

import platform
import shutil

from spot3d import __version__
from spot3d.dataflow.about import shared_memory_bytes, snapshot_disk, zenoh_version
from spot3d.dataflow.kernel_cache import stage_kernels_missing
from spot3d.dataflow.settings import LinkSettings
from spot3d.dataflow.tls import TlsError, own_certificate
from spot3d.doctor.finding import Finding, checked
from spot3d_schemas import STAGES

SHARED_BYTES = 128 << 20
"""Least free memory: Zenoh's pool is 16 MiB a process, for six stages and readers."""
DISK_BYTES = 2 << 30
"""Least free space: a map of a long flight and its successor are some hundred MB."""
_RENEW = "make a new one: spot3d certificates --out FOLDER NAME --renew"


def look_here(link: LinkSettings) -> list[Finding]:
    """Versions, certificate, kernels, shared memory and disk of this device."""
    versions = f"spot3d {__version__}, zenoh {zenoh_version()}, Python {platform.python_version()}"
    modules = sum(map(stage_kernels_missing, (*STAGES, "geometry")))
    folder = snapshot_disk(link)
    return [
        Finding("ok", "versions here", versions),
        certificate(link),
        kernels(modules, "here"),
        shared_memory(shared_memory_bytes() if link.shared_memory else 0, "here"),
        disk(str(folder), shutil.disk_usage(folder).free, "here"),
    ]


def certificate(link: LinkSettings) -> Finding:
    """This side's certificate, as the other side would see it."""
    try:
        own = own_certificate(link)
    except TlsError as error:
        return Finding("problem", "certificate", str(error), _RENEW)
    if own is None:
        return Finding("ok", "certificate", "none is set ([link] certificate, key, ca): anybody can connect")
    return checked(own.soon_over, "certificate", str(own), _RENEW)


def kernels(missing: int, where: str) -> Finding:
    """Finding about kernels. missing: number of modules whose kernels are not compiled."""
    if not missing:
        return Finding("ok", f"kernels {where}", "compiled and cached")
    text = f"{missing} modules have kernels that are not compiled yet: their first use takes seconds"
    return Finding(
        "note", f"kernels {where}", text, "start every stage once before the mission, or run spot3d demo --frames 30"
    )


def shared_memory(room: int, where: str) -> Finding:
    """Finding about shared memory. room: bytes left for images; 0: not used."""
    if not room:
        text = (
            "not used (off, no /dev/shm, or a lossless run): images go through the network stack, at twice the CPU time"
        )
        remedy = "for a live run, mount /dev/shm and keep link.shared_memory on; a lossless run does not use it"
        return Finding("note", f"shared memory {where}", text, remedy)
    remedy = f"enlarge it to {SHARED_BYTES >> 20} MB (docker: --shm-size), or set link.shared_memory = false"
    return checked(room < SHARED_BYTES, f"shared memory {where}", f"{room / 1e6:.0f} MB left", remedy)


def disk(folder: str, free: int, where: str) -> Finding:
    """Finding about the disk. free: bytes left in `folder`, where snapshots of the map are kept."""
    remedy = f"free some space: snapshots of the map need up to {DISK_BYTES >> 30} GB"
    return checked(free < DISK_BYTES, f"disk {where}", f"{free / 1e9:.1f} GB left in {folder}", remedy)
