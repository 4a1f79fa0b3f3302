"""Bytes in shared memory count only while nobody has taken the memory back."""

from dataclasses import dataclass
from typing import Any, cast

import pytest
import zenoh

from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings
from spot3d_schemas import CodecError
from spot3d_schemas.limits import MAX_MESSAGE_BYTES


@dataclass
class Payload:
    """As Zenoh's: the memory is taken back while `to_bytes` copies, or is not."""

    shared: bool
    taken_back: bool
    copied: bool = False
    length: int = 5

    def __len__(self) -> int:
        return self.length

    def to_bytes(self) -> bytes:
        self.copied = True
        return b"bytes"

    def as_shm(self) -> "Payload | None":
        return self if self.shared else None

    def is_valid(self) -> bool:
        return not (self.copied and self.taken_back)


@pytest.mark.parametrize(
    ("shared", "taken_back", "expected"), [(False, False, b"bytes"), (True, False, b"bytes"), (True, True, None)]
)
def test_memory_taken_back_during_the_copy_is_noticed(shared, taken_back, expected):
    payload: Any = Payload(shared, taken_back)
    assert intact_bytes(payload) == expected


def test_more_than_a_message_may_have_is_not_copied() -> None:
    """Shared memory can hold any number of bytes: Zenoh's own limit is for what arrives over a connection."""
    payload = Payload(shared=True, taken_back=False, length=MAX_MESSAGE_BYTES + 1)
    with pytest.raises(CodecError, match="payload: 67108865 bytes exceed the limit of 67108864 for a message"):
        intact_bytes(cast(zenoh.ZBytes, payload))
    assert not payload.copied


@pytest.mark.parametrize(
    ("delivery", "wanted", "expected"),
    [("live", True, "true"), ("live", False, "false"), ("lossless", True, "false")],
)
def test_a_lossless_run_does_not_use_memory_that_can_be_taken_back(delivery, wanted, expected):
    config = zenoh_config(LinkSettings(delivery=delivery, shared_memory=wanted))
    assert config.get_json("transport/shared_memory/enabled") == expected
