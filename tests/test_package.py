"""What `from spot3d import ...` offers."""

import subprocess
import sys

import pytest

import spot3d


@pytest.mark.parametrize("name", spot3d.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(spot3d, name).__name__ == name


def test_the_package_alone_loads_nothing() -> None:
    code = "import sys, spot3d; print([name for name in ('numpy', 'pydantic', 'cv2', 'numba') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


def test_what_it_does_not_have_is_named() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Fusoin'"):
        spot3d.Fusoin  # noqa: B018
