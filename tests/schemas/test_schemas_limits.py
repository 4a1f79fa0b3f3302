"""Decoding never allocates more than the limits, whatever the bytes say."""

import tracemalloc
import zlib
from typing import Any

import msgpack
import numpy as np
import pytest
from schemas_samples import HEADER, SAMPLES, rgbd

from spot3d_schemas import MESSAGES, CodecError, Frame, Heat, MapPoints, Objects, Pose, decode, encode
from spot3d_schemas.limits import (
    MAX_DECODE_BYTES,
    MAX_IMAGE_PIXELS,
    MAX_MAP_POINTS,
    MAX_MESSAGE_BYTES,
    MAX_OBJECTS,
    MAX_OBJECTS_BYTES,
    MAX_OBJECTS_VALUES,
)
from spot3d_schemas.wire import map_spans


def refuse_within(payload: bytes, name: str, budget: int) -> str:
    """The refusal's text; fails where decoding allocates more than `budget` bytes on its way to it."""
    tracemalloc.start()
    try:
        with pytest.raises(CodecError) as caught:
            decode(payload, MESSAGES[name])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < budget
    return str(caught.value)


def wire_of(name: str, **fields: Any) -> bytes:
    return msgpack.packb(msgpack.unpackb(encode(SAMPLES[name])) | fields)


def array(dtype: str, shape: list[int], encoding: str, data: bytes) -> dict[str, Any]:
    return {"dtype": dtype, "shape": shape, "encoding": encoding, "data": data}


@pytest.mark.parametrize("encoding", ["raw", "delta-zlib"])
@pytest.mark.parametrize("shape", [[2**31, 2**31], [2**63, 1], [1, MAX_IMAGE_PIXELS + 1], [2048, 2048]])
def test_a_tiny_message_that_declares_a_giant_image(encoding: str, shape: list[int]) -> None:
    payload = wire_of("Frame", depth=array("uint16", shape, encoding, b"x"))
    assert "spot3d.Frame.depth" in refuse_within(payload, "Frame", 200_000)


@pytest.mark.parametrize("size", [[4, 6], [2048, 2048]])
def test_a_zlib_bomb_is_cut_at_the_declared_size(size: list[int]) -> None:
    bomb = zlib.compress(bytes(100_000_000), 9)
    payload = wire_of("Frame", depth=array("uint16", size, "delta-zlib", bomb))
    declared = size[0] * size[1] * 2
    assert "is not the" in refuse_within(payload, "Frame", 200_000 + 3 * declared)


def test_jpeg_whose_header_states_another_size() -> None:
    cv2 = pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    jpeg = bytearray(cv2.imencode(".jpg", np.zeros((4, 6, 3), np.uint8))[1])
    at = jpeg.index(b"\xff\xc0")
    jpeg[at + 5 : at + 9] = b"\xff\xff\xff\xff"
    payload = wire_of("Frame", colour=array("uint8", [4, 6, 3], "jpeg", bytes(jpeg)))
    assert "65535x65535" in refuse_within(payload, "Frame", 200_000)


def test_progressive_jpeg_and_other_image_files_are_refused() -> None:
    cv2 = pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    image = np.zeros((4, 6, 3), np.uint8)
    progressive = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    for data in (progressive, cv2.imencode(".png", image)[1].tobytes(), b"\xff\xd8\xff\xd9", b""):
        payload = wire_of("Frame", colour=array("uint8", [4, 6, 3], "jpeg", data))
        with pytest.raises(CodecError, match=r"spot3d\.Frame\.colour: .*JPEG"):
            decode(payload, Frame)


def test_jpeg_that_repeats_scans_is_refused() -> None:
    """Each takes the time of a whole image; a preview in the application data has its own, which is skipped."""
    cv2 = pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    jpeg = cv2.imencode(".jpg", np.zeros((4, 6, 3), np.uint8))[1].tobytes()
    preview = b"\xff\xe1" + (2 + 5 * 2).to_bytes(2, "big") + b"\xff\xda" * 5
    whole = jpeg[:2] + preview + jpeg[2:]
    assert not decode(wire_of("Frame", colour=array("uint8", [4, 6, 3], "jpeg", whole)), Frame).colour.any()
    empty_scan = b"\xff\xda\x00\x08\x01\x01\x00\x00\x3f\x00"
    payload = wire_of("Frame", colour=array("uint8", [4, 6, 3], "jpeg", whole[:-2] + 3 * empty_scan + whole[-2:]))
    with pytest.raises(CodecError, match=r"spot3d\.Frame\.colour: the JPEG has more than 3 scans; send baseline JPEG"):
        decode(payload, Frame)


@pytest.mark.parametrize("filler", [b"\x90", b"\x80", b"\xa0", b"\xa2ab", b"\xcd\xff\xff"])
def test_many_tiny_values_are_refused_before_they_are_built(filler: bytes) -> None:
    count = 300_000
    payload = b"\x81\xa6header\xdd" + count.to_bytes(4, "big") + filler * count
    assert "more values" in refuse_within(payload, "Pose", 200_000)


@pytest.mark.parametrize(("filler", "values"), [(b"\x80", 1), (b"\x81\xa0\x90", 3)])
def test_the_worst_list_of_objects_stays_within_the_limit(filler: bytes, values: int) -> None:
    # A part of the limit, as long as it takes; a part of the memory in return.
    count = MAX_OBJECTS_VALUES // 8 // values
    body = filler * count
    rest = msgpack.packb(msgpack.unpackb(encode(SAMPLES["Objects"])) | {"objects": 0})
    at = rest.index(b"\xa7objects") + 8
    payload = rest[:at] + b"\xdd" + count.to_bytes(4, "big") + body + rest[at + 1 :]
    assert "spot3d.Objects.objects" in refuse_within(payload, "Objects", MAX_DECODE_BYTES // 8)


def test_ten_thousand_wrong_objects_stay_within_the_limit() -> None:
    refuse_within(wire_of("Objects", objects=[{}] * MAX_OBJECTS), "Objects", MAX_DECODE_BYTES)


def test_the_most_objects_fit() -> None:
    message = SAMPLES["Objects"]
    assert isinstance(message, Objects)
    most = message.model_copy(update={"objects": message.objects * MAX_OBJECTS})
    payload = encode(most)
    assert len(payload) < MAX_OBJECTS_BYTES / 2
    assert len(decode(payload, Objects).objects) == MAX_OBJECTS
    with pytest.raises(CodecError, match=r"spot3d\.Objects\.objects: .*10000"):
        decode(encode(message.model_copy(update={"objects": message.objects * (MAX_OBJECTS + 1)})), Objects)


def test_the_largest_frame_decodes_without_copies() -> None:
    payload = encode(Frame(**rgbd(2048, 2048, np.float32), T_world_camera=None))
    assert len(payload) < MAX_MESSAGE_BYTES
    tracemalloc.start()
    try:
        frame = decode(payload, Frame)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert frame.depth.shape == (2048, 2048)
    assert peak < 100_000


def test_the_largest_thin_message_stays_within_the_limit() -> None:
    pytest.importorskip("cv2", reason="JPEG needs OpenCV")
    fields = rgbd(2048, 2048, np.float32)
    heat = np.zeros((2048, 2048), np.uint8)
    payload = encode(Heat(**fields, heat=heat, accepted=0, masked=0, rejected=0), thin_link=True)
    tracemalloc.start()
    try:
        back = decode(payload, Heat)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.array_equal(back.depth, fields["depth"])
    assert peak < MAX_DECODE_BYTES


def test_the_longest_message() -> None:
    assert MAX_MAP_POINTS * 23 < MAX_MESSAGE_BYTES
    assert "exceed the limit of" in refuse_within(bytes(MAX_MESSAGE_BYTES + 1), "Pose", 100_000)


def test_too_many_map_points_cannot_be_made() -> None:
    n = MAX_MAP_POINTS + 1
    rows = np.broadcast_to(np.zeros((1, 3), np.float32), (n, 3))
    with pytest.raises(ValueError, match="limit of 2000000 N"):
        MapPoints(
            header=HEADER,
            xyz=rows,
            rgb=np.zeros((0, 3), np.uint8),
            heat=np.zeros(0, np.float32),
            frequency=np.zeros(0, np.uint32),
            total=n,
        )


def test_a_giant_unknown_field_is_stepped_over() -> None:
    payload = wire_of("Pose", blob=bytes(10_000_000))
    tracemalloc.start()
    try:
        decode(payload, Pose)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100_000


@pytest.mark.parametrize(("most", "accepted"), [(0, False), (1, False), (2, False), (4, False), (5, True)])
def test_all_values_of_a_map_count(most: int, accepted: bool) -> None:
    payload = memoryview(msgpack.packb({"a": 1, "b": 2.5, "c": [1, "two"]}))
    if accepted:
        assert list(map_spans(payload, (0, len(payload)), 3, most)) == ["a", "b", "c"]
    else:
        with pytest.raises(ValueError, match="more values than the limit"):
            map_spans(payload, (0, len(payload)), 3, most)
