"""Whether the machine code of kernels is kept, so that the next start does not compile for ten seconds."""

import os
import sys
from pathlib import Path

_DECORATOR = "\n@kernel("
_SERVICES = Path(__file__).parents[1]


def stage_kernels_missing(stage: str) -> int:
    """How many modules of a stage have kernels that are not compiled; none of the source's count.

    Each of those is for one kind of input, which waits for it: no run needs them all.
    """
    return 0 if stage == "source" else len(kernels_missing(_SERVICES / stage))


def kernels_missing(folder: Path) -> list[Path]:
    """Modules below `folder` that define kernels and of which numba's cache holds nothing newer than themselves.

    Looked for where numba looks: in NUMBA_CACHE_DIR, else beside the modules, else in the user's own cache.
    """
    kept: dict[str, float] = {}
    for index in _indices(folder):
        # module.function-line.py311.nbi
        module = index.name.partition(".")[0]
        kept[module] = max(kept.get(module, 0.0), index.stat().st_mtime)
    modules = [path for path in sorted(folder.rglob("*.py")) if _DECORATOR in path.read_text(encoding="utf-8")]
    return [path for path in modules if kept.get(path.stem, 0.0) < path.stat().st_mtime]


def _indices(folder: Path) -> list[Path]:
    pattern = f"*.py{sys.version_info.major}{sys.version_info.minor}.nbi"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return list(Path(chosen).rglob(pattern))
    own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    return [*folder.rglob(f"__pycache__/{pattern}"), *own.rglob(pattern)]
