"""Message about a package that is not installed: which of spot3d's extras brings it."""

from importlib.util import find_spec

_EXTRAS = {
    "cryptography": "certificates",
    "foxglove": "foxglove",
    "mcap": "record",
    "small_gicp": "gicp",
    "viser": "dashboard",
    "zstandard": "record",
}
"""The extras of packages that no stage needs."""


def refuse_missing(*packages: str) -> None:
    """Raise ModuleNotFoundError for the first of these packages that is not installed; imports none."""
    for package in packages:
        if find_spec(package) is None:
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)


def in_words(error: ModuleNotFoundError) -> str:
    """Which package is missing and what to install; for a module of spot3d itself, Python's own message."""
    package = (error.name or "").partition(".")[0]
    if package in ("", "spot3d", "spot3d_schemas"):
        return str(error)
    if extra := _EXTRAS.get(package):
        return f"{error.name} is not installed; install it with: pip install 'spot3d[{extra}]'"
    return f"{error.name} is not installed; install the packages of all stages with: pip install 'spot3d[all]'"
