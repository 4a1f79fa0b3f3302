"""What the dashboard's connection does with messages that are none."""

from types import SimpleNamespace

import pytest
import zenoh

from spot3d.dashboard.link import Link
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import key


def test_malformed_messages_of_a_topic_are_logged_once_in_a_while(caplog: pytest.LogCaptureFixture) -> None:
    """The file dashboard.log has no limit."""
    waiting = [SimpleNamespace(key_expr=key("r", "pose/health"), payload=zenoh.ZBytes(b"none")) for _ in range(500)]
    link = Link(LinkSettings(), 1.0)
    link._fleet["pose/health"] = SimpleNamespace(try_recv=lambda: waiting.pop() if waiting else None)
    assert list(link.drain()) == []
    assert not waiting
    (line,) = caplog.messages
    assert line.startswith("spot3d/r/pose/health: message refused: ")
