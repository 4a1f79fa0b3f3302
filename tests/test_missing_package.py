"""Where the base package alone is installed, what is asked for says which extra brings what it lacks."""

import subprocess
import sys

import pytest

from spot3d.dataflow.warm_up import warm_up
from spot3d.missing_package import in_words

WITHOUT = """
import sys
for name in ("numba", "cv2", "scipy", "sklearn", "kiss_icp", "small_gicp"):
    sys.modules[name] = None
"""


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("cv2", "cv2 is not installed; install the packages of all stages with: pip install 'spot3d[all]'"),
        (
            "scipy.spatial",
            "scipy.spatial is not installed; install the packages of all stages with: pip install 'spot3d[all]'",
        ),
        ("small_gicp", "small_gicp is not installed; install it with: pip install 'spot3d[gicp]'"),
        ("mcap.writer", "mcap.writer is not installed; install it with: pip install 'spot3d[record]'"),
        ("spot3d.fused", "as Python says it"),
        (None, "as Python says it"),
    ],
)
def test_the_extra_is_named(name: str | None, told: str) -> None:
    assert in_words(ModuleNotFoundError("as Python says it", name=name)) == told


@pytest.mark.parametrize("name", ["propose", "find_segments", "Fusion", "run_pipeline"])
def test_the_package_says_it(name: str) -> None:
    code = f"{WITHOUT}\nfrom spot3d import {name}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "is not installed; install the packages of all stages with: pip install" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("stage", "provider", "extra"), [("segments", "kiss", "all"), ("fusion", "kiss", "all"), ("pose", "gicp", "gicp")]
)
def test_a_stage_says_it_at_once(stage: str, provider: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Segments load their core late: they waited for a router, and failed behind it."""
    monkeypatch.setenv("SPOT3D_POSE__PROVIDER", provider)
    hidden = WITHOUT if extra == "all" else "import sys\nsys.modules['small_gicp'] = None"
    argv = [stage, "--connect", "tcp/127.0.0.1:1"]
    code = f"{hidden}\nsys.argv[1:] = {argv}\nfrom spot3d.__main__ import main\nmain()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"pip install 'spot3d[{extra}]'" in line


def test_a_warm_up_does_not_hide_what_is_missing() -> None:
    def lacks(_frames: object) -> None:
        raise ModuleNotFoundError("No module named 'numba'", name="numba")

    with pytest.raises(ModuleNotFoundError, match="numba"):
        warm_up("segments", lacks)
