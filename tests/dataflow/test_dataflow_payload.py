"""Bytes in shared memory count only while nobody has taken the memory back."""

from dataclasses import dataclass
from typing import Any

import pytest

from spot3d.dataflow.payload import intact_bytes
from spot3d.dataflow.session import zenoh_config
from spot3d.dataflow.settings import LinkSettings


@dataclass
class Payload:
    """As Zenoh's: the memory is taken back while `to_bytes` copies, or is not."""

    shared: bool
    taken_back: bool
    copied: bool = False

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


@pytest.mark.parametrize(
    ("delivery", "wanted", "expected"),
    [("live", True, "true"), ("live", False, "false"), ("lossless", True, "false")],
)
def test_a_lossless_run_does_not_use_memory_that_can_be_taken_back(delivery, wanted, expected):
    config = zenoh_config(LinkSettings(delivery=delivery, shared_memory=wanted))
    assert config.get_json("transport/shared_memory/enabled") == expected
