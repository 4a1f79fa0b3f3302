"""No bytes make the decoder raise anything but its own error."""

from contextlib import suppress
from typing import Any

import msgpack
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from schemas_samples import SAMPLES

from spot3d_schemas import MESSAGES, CodecError, decode, encode, peek_header

RAW = {name: encode(sample) for name, sample in SAMPLES.items()}
NAMES = sorted(MESSAGES)
fuzz = settings(max_examples=30)

keys = st.sampled_from(["header", "schema", "shape", "data", "dtype", "encoding", "boxes", "x"])
values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=8)
    | st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=4))
    | st.builds(msgpack.Timestamp, st.integers(0, 2**33)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys | st.text(max_size=4), inner, max_size=4),
    max_leaves=12,
)


def decodes_or_refuses(payload: bytes, name: str) -> None:
    # What is accepted can be sent on. (Not compared: a mutation may have made NaN points.)
    with suppress(CodecError):
        encode(decode(payload, MESSAGES[name]))
    with suppress(CodecError):
        peek_header(payload)


def paths(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The key paths of everything inside a decoded msgpack value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [found for key, inner in items for found in [(*path, key), *paths(inner, (*path, key))]]


@pytest.mark.parametrize("name", NAMES)
@fuzz
@given(payload=st.binary(max_size=200))
@example(payload=b"")
@example(payload=b"\x91" * 5000)
@example(payload=b"\x81\xa6header" + b"\x91" * 3000 + b"\xc0")
@example(payload=b"\x81\xa6header\xc7\x05\xff12345")
def test_random_bytes(name: str, payload: bytes) -> None:
    decodes_or_refuses(payload, name)


@pytest.mark.parametrize("name", NAMES)
@fuzz
@given(value=values)
def test_random_msgpack(name: str, value: Any) -> None:
    decodes_or_refuses(msgpack.packb(value), name)


@pytest.mark.parametrize("name", NAMES)
@fuzz
@given(data=st.data())
def test_mutated_fields(name: str, data: st.DataObject) -> None:
    wire = msgpack.unpackb(RAW[name])
    for _ in range(data.draw(st.integers(1, 2))):
        *keys_to, last = data.draw(st.sampled_from(paths(wire)))
        at = wire
        for key in keys_to:
            at = at[key]
        if data.draw(st.booleans()) and isinstance(at, dict):
            del at[last]
        else:
            at[last] = data.draw(values)
    decodes_or_refuses(msgpack.packb(wire), name)


@pytest.mark.parametrize("name", NAMES)
def test_every_truncation_is_refused(name: str) -> None:
    for length in range(len(RAW[name])):
        with pytest.raises(CodecError):
            decode(RAW[name][:length], MESSAGES[name])


@pytest.mark.parametrize("thin_link", [False, True])
@pytest.mark.parametrize("name", NAMES)
@fuzz
@given(data=st.data())
def test_flipped_bytes(name: str, thin_link: bool, data: st.DataObject) -> None:
    if thin_link:
        pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    payload = bytearray(encode(SAMPLES[name], thin_link=thin_link))
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    decodes_or_refuses(bytes(payload), name)
