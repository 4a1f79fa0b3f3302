"""Whether compiled kernels are cached, so that the next start does not compile for ten seconds."""

import hashlib
import os
import sys
from pathlib import Path

_DECORATOR = "\n@kernel("
_SERVICES = Path(__file__).parents[1]


def stage_kernels_missing(stage: str) -> int:
    """Number of a stage's modules whose kernels are not compiled; 0 for the source.

    Each of its modules serves one kind of input, which waits for the kernels: no run needs them all.
    """
    return 0 if stage == "source" else len(kernels_missing(_SERVICES / stage))


def kernels_missing(folder: Path) -> list[Path]:
    """Modules below `folder` that define kernels, and for which numba's cache holds nothing newer than the module.

    The cache is looked for where numba does: in NUMBA_CACHE_DIR, else beside the modules and in the user's own cache.
    """
    modules = [path for path in sorted(folder.rglob("*.py")) if _DECORATOR in path.read_text(encoding="utf-8")]
    return [path for path in modules if _compiled_s(path) < path.stat().st_mtime]


def _compiled_s(module: Path) -> float:
    """When the newest of a module's kernels was compiled, seconds since 1970; 0 where none is kept."""
    # module.function-line.py311.nbi
    pattern = f"{module.stem}.*.py{sys.version_info.major}{sys.version_info.minor}.nbi"
    indices = (index for place in _places(module.parent) for index in place.glob(pattern))
    return max((index.stat().st_mtime for index in indices), default=0.0)


def _places(folder: Path) -> list[Path]:
    """The folders where numba caches the compiled kernels of the modules in a folder."""
    # Named as in numba.core.caching, which tells modules of one name in two folders apart by the hash.
    name = f"{folder.name}_{hashlib.sha1(str(folder.absolute()).encode()).hexdigest()}"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return [Path(chosen) / name]
    own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    return [folder / "__pycache__", own / name]
