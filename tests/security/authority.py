"""A private authority with the certificates of a small fleet, and one of a stranger, for tests with real routers."""

import datetime
from pathlib import Path

from spot3d.dataflow.settings import LinkSettings
from spot3d.security.certificates import issue, open_authority

NAMES = ("ground", "drone", "other-drone", "dashboard")


def make_fleet(folder: Path) -> Path:
    """Certificates of NAMES for 127.0.0.1, `expired.pem` of a drone, and a stranger's authority with a drone's."""
    now = datetime.datetime.now(datetime.UTC)
    hour = datetime.timedelta(hours=1)
    stranger = folder / "stranger"
    stranger.mkdir(parents=True)
    ours = open_authority(folder, now)
    for name in NAMES:
        issue(ours, folder, name, ["127.0.0.1"], begins=now - hour, ends=now + hour)
    issue(ours, folder, "expired", ["127.0.0.1"], begins=now - 2 * hour, ends=now - hour)
    issue(open_authority(stranger, now), stranger, "drone", begins=now - hour, ends=now + hour)
    return folder


def link(folder: Path, name: str | None, *connect: str, key: str | None = None) -> LinkSettings:
    """A client's link with the certificate of `name` (None: without any), and perhaps another's key."""
    if name is None:
        return LinkSettings(connect=connect, ca=folder / "ca.pem")
    files = {"certificate": folder / f"{name}.pem", "key": folder / f"{key or name}.key"}
    return LinkSettings(connect=connect, ca=folder / "ca.pem", **files)
