"""A package that is not installed, in words: which of spot3d's extras brings it."""

_EXTRAS = {
    "cryptography": "certificates",
    "foxglove": "foxglove",
    "mcap": "record",
    "small_gicp": "gicp",
    "viser": "dashboard",
    "zstandard": "record",
}
"""Of packages that no stage needs."""


def in_words(error: ModuleNotFoundError) -> str:
    """What is not installed, and what to install; of a module of spot3d's own, which is none, what Python says."""
    package = (error.name or "").partition(".")[0]
    if package in ("", "spot3d", "spot3d_schemas"):
        return str(error)
    if extra := _EXTRAS.get(package):
        return f"{error.name} is not installed; it comes with: pip install 'spot3d[{extra}]'"
    return f"{error.name} is not installed; every stage's packages come with: pip install 'spot3d[all]'"
