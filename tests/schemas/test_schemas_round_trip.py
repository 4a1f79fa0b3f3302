"""Every message survives the wire, and its arrays are views of it."""

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from schemas_samples import MESSAGES_OF, SAMPLES, rgbd

from spot3d_schemas import (
    MESSAGES,
    Frame,
    Heat,
    MapPoints,
    Message,
    Objects,
    Pose,
    Proposals,
    WireHeader,
    decode,
    encode,
    peek_header,
)
from spot3d_schemas.codec import array_fields

NAMES = sorted(MESSAGES)


def same(one: object, other: object) -> bool:
    """Equal to the bit: NaN equals NaN, 0.0 does not equal -0.0."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    return one == other


def test_samples_and_strategies_cover_every_message() -> None:
    assert sorted(SAMPLES) == sorted(MESSAGES_OF) == NAMES


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(data=st.data())
def test_round_trip(name: str, data: st.DataObject) -> None:
    message = data.draw(MESSAGES_OF[name])
    back = decode(encode(message), MESSAGES[name])
    for field, value in message:
        assert same(value, getattr(back, field)), field


@pytest.mark.parametrize("name", NAMES)
def test_sample_round_trip_equals(name: str) -> None:
    assert decode(encode(SAMPLES[name]), MESSAGES[name]) == SAMPLES[name]


@pytest.mark.parametrize("name", ["Frame", "Heat"])
@settings(max_examples=20)
@given(data=st.data())
def test_thin_link_keeps_depth_and_heat_to_the_bit(name: str, data: st.DataObject) -> None:
    pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    message = data.draw(MESSAGES_OF[name])
    back = decode(encode(message, thin_link=True), MESSAGES[name])
    for field, value in message:
        assert field == "colour" or same(value, getattr(back, field)), field


@pytest.mark.parametrize("dtype", [np.uint16, np.float32])
def test_thin_link_is_thin_and_colour_stays_close(dtype: type) -> None:
    pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    fields = rgbd(48, 64, dtype)
    fields["colour"] = np.stack(np.broadcast_arrays(*np.ogrid[40:88, 60:124], 200), axis=-1).astype(np.uint8)
    frame = Frame(**fields, T_world_camera=None)
    thin = encode(frame, thin_link=True, jpeg_quality=95)
    assert len(thin) < len(encode(frame)) / 2
    back = decode(thin, Frame)
    # Red and blue differ by more than this everywhere: the channels' order is tested too.
    assert np.abs(back.colour.astype(int) - frame.colour).max() < 12
    assert same(back.depth, frame.depth)


@pytest.mark.parametrize("name", ["Frame", "Heat", "Proposals", "MapPoints"])
@pytest.mark.parametrize("container", [bytes, bytearray, memoryview])
def test_arrays_are_read_only_aligned_views_of_the_payload(name: str, container: type) -> None:
    payload = container(encode(SAMPLES[name]))
    back = decode(payload, MESSAGES[name])
    whole = np.frombuffer(payload, np.uint8)
    for field in array_fields(MESSAGES[name]):
        array = getattr(back, field)
        assert np.shares_memory(array, whole), field
        assert array.flags.aligned
        assert array.flags.c_contiguous
        assert not array.flags.writeable


def test_a_misaligned_sender_costs_a_copy_not_an_error() -> None:
    payload = encode(SAMPLES["MapPoints"])
    shifted = memoryview(b"x" + payload)[1:]
    back = decode(shifted, MapPoints)
    assert back == SAMPLES["MapPoints"]
    assert back.xyz.flags.aligned
    assert not back.xyz.flags.writeable


def test_plain_msgpack_reads_and_writes_the_same_message() -> None:
    """What a client in another language does: generic msgpack, no padding, any order of keys."""
    read = msgpack.unpackb(encode(SAMPLES["Heat"]))
    assert read["header"]["schema"] == "spot3d.Heat"
    assert read["depth"]["shape"] == [4, 6]
    for field in ("colour", "depth", "heat"):
        del read[field]["pad"]
    written = msgpack.packb(dict(reversed(read.items())))
    assert decode(written, Heat) == SAMPLES["Heat"]


@pytest.mark.parametrize(
    "make",
    [
        lambda a: np.asfortranarray(a),
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: a[::-1][::-1],
        lambda a: np.frombuffer(b"x" + a.tobytes(), np.uint8)[1:].view(a.dtype).reshape(a.shape),
    ],
)
def test_arrays_of_any_layout_can_be_sent(make: object) -> None:
    assert callable(make)
    boxes = np.arange(15, dtype=np.float32).reshape(3, 5)
    message = Proposals(header=SAMPLES["Proposals"].header, boxes=make(boxes))
    assert np.array_equal(decode(encode(message), Proposals).boxes, boxes)


@pytest.mark.parametrize("decimals", [3, 4, 6, 15])
def test_rounded_rotations_are_made_exact_and_others_stay_as_they_were_sent(decimals: int) -> None:
    c, s = np.cos(0.3), np.sin(0.3)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    T[:3, 3] = 1.23456789, -2.0, 3.0
    sent = T.copy()
    sent[:3, :3] = np.round(T[:3, :3], decimals)
    pose = SAMPLES["Pose"].model_copy(update={"T_world_camera": sent})
    got = decode(encode(pose), Pose).T_world_camera
    if decimals >= 6:
        np.testing.assert_array_equal(got, sent)
        return
    np.testing.assert_allclose(got[:3, :3] @ got[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(got, sent, atol=1e-3)
    np.testing.assert_array_equal(got[:, 3], sent[:, 3])
    wire = msgpack.unpackb(encode(SAMPLES["Objects"]))
    wire["objects"][0]["rotation"] = sent[:3, :3].ravel().tolist()
    rotation = decode(msgpack.packb(wire), Objects).objects[0].rotation
    np.testing.assert_array_equal(rotation, got[:3, :3])
    assert not rotation.flags.writeable


def test_a_message_does_not_lock_the_array_that_it_was_made_of() -> None:
    boxes = np.zeros((1, 5), np.float32)
    message = Proposals(header=SAMPLES["Proposals"].header, boxes=boxes)
    assert not message.boxes.flags.writeable
    boxes[0, 0] = 1


@pytest.mark.parametrize("name", NAMES)
def test_peek_header(name: str) -> None:
    sample: Message = SAMPLES[name]
    header = peek_header(encode(sample))
    assert isinstance(header, WireHeader)
    assert (header.schema_name, header.version) == (f"spot3d.{name}", MESSAGES[name].VERSION)
    assert (header.robot, header.seq, header.trace) == ("drone", 7, sample.header.trace)


def test_peek_header_reads_other_majors() -> None:
    wire = msgpack.unpackb(encode(SAMPLES["Pose"]))
    wire["header"]["version"] = "9.4"
    wire["T_world_camera"] = "something new"
    assert peek_header(msgpack.packb(wire)).version == "9.4"
