"""RealSense's SDK where it is not installed, or cannot be loaded."""

import sys
from pathlib import Path

import pytest

from spot3d.source.errors import SourceError
from spot3d.source.realsense.framesets import sdk


def test_an_sdk_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(SourceError, match=r"need pyrealsense2, which is not installed: pip install"):
        sdk()


def test_an_sdk_that_lacks_a_library_of_the_system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    lacking = "libusb-1.0.so.0: cannot open shared object file"
    (tmp_path / "pyrealsense2.py").write_text(f"raise ImportError({lacking!r})\n")
    monkeypatch.delitem(sys.modules, "pyrealsense2", raising=False)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SourceError, match=rf"cannot be loaded \({lacking}\).*libusb-1.0-0"):
        sdk()
