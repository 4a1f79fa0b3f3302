"""What several tests of recordings read."""

from pathlib import Path

import pytest
from recordings import PERIOD_NS, frame, write_recording


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Six frames in three chunks."""
    path = tmp_path / "six.mcap"
    sent = [("source/frame", 0.1 * seq, frame(seq, PERIOD_NS * seq)) for seq in range(6)]
    write_recording(path, [sent[:2], sent[2:4], sent[4:]])
    return path
