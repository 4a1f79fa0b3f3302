"""What is refused, and that the refusal names the schema, the field and the remedy."""

import sys
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import pytest
from pydantic import ValidationError
from schemas_samples import HEADER, SAMPLES, quarter_turn, rgbd

from spot3d_schemas import (
    MESSAGES,
    CodecError,
    Frame,
    Header,
    Heat,
    Objects,
    Pose,
    Proposals,
    Segments,
    decode,
    encode,
    encoding,
    refuse_encoding,
)

Wire = dict[str, Any]


def put(*path: Any) -> Callable[[Wire], None]:
    """An edit of a wire map: the last item of `path` is the value of the key path before it."""
    *keys, last, value = path

    def edit(wire: Wire) -> None:
        at: Any = wire
        for step in keys:
            at = at[step]
        at[last] = value

    return edit


def drop(field: str) -> Callable[[Wire], None]:
    return lambda wire: wire.pop(field)


NAN = float("nan")
HOP = {"stage": "pose", "received_ns": 1, "sent_ns": 2}
MIRROR = np.diag([1.0, 1, -1, 1]).ravel().tolist()
STRETCHED = (np.eye(4) * [1.01, 1, 1, 1]).ravel().tolist()
NO_BOTTOM = np.array([*np.eye(4)[:3].ravel(), 0, 0, 0.1, 1]).tolist()


@pytest.mark.parametrize(
    ("name", "edit", "texts"),
    [
        ("Frame", dict.clear, ["spot3d.Frame.header", "missing"]),
        ("Frame", put("header", 5), ["spot3d.Frame.header", "map"]),
        (
            "Frame",
            put("header", "schema", "spot3d.Heat"),
            ["spot3d.Frame.header.schema", "spot3d.Heat", "topic"],
        ),
        ("Frame", put("header", "version", 1.0), ["spot3d.Frame.header.version", Frame.VERSION]),
        ("Frame", put("header", "version", "1"), ["spot3d.Frame.header.version", Frame.VERSION]),
        ("Frame", put("header", "robot", "a/b"), ["spot3d.Frame.header.robot", "a/b"]),
        ("Frame", put("header", "seq", -1), ["spot3d.Frame.header.seq", "-1"]),
        ("Frame", put("header", "stamp_ns", 1.5), ["spot3d.Frame.header.stamp_ns", "1.5"]),
        ("Frame", put("header", "trace", [HOP] * 17), ["spot3d.Frame.header.trace", "16"]),
        ("Frame", drop("intrinsics"), ["spot3d.Frame.intrinsics", "required"]),
        ("Frame", drop("depth_scale"), ["spot3d.Frame.depth_scale", "required"]),
        ("Frame", drop("T_world_camera"), ["spot3d.Frame.T_world_camera", "required"]),
        ("Frame", put("intrinsics", "fx", 0.0), ["spot3d.Frame.intrinsics.fx", "greater"]),
        ("Frame", put("intrinsics", "cx", NAN), ["spot3d.Frame.intrinsics.cx", "finite"]),
        ("Frame", put("intrinsics", "width", 7), ["spot3d.Frame.colour", "intrinsics", "[4, 7]"]),
        ("Frame", put("intrinsics", "width", 8193), ["spot3d.Frame.intrinsics.width", "8192"]),
        ("Frame", put("depth_scale", float("inf")), ["spot3d.Frame.depth_scale", "finite"]),
        ("Frame", put("colour", b"x"), ["spot3d.Frame.colour", "map"]),
        ("Frame", put("depth", "dtype", "int32"), ["spot3d.Frame.depth", "int32", "uint16 or float32"]),
        ("Frame", put("depth", "dtype", 3), ["spot3d.Frame.depth", "uint16 or float32"]),
        ("Frame", put("depth", "dtype", ["uint16"]), ["spot3d.Frame.depth", "uint16 or float32"]),
        ("Frame", put("depth", "shape", [4, 7]), ["spot3d.Frame.depth", "48 bytes", "56"]),
        ("Frame", put("depth", "shape", [24]), ["spot3d.Frame.depth", "(h, w)"]),
        ("Frame", put("depth", "shape", [4, -6]), ["spot3d.Frame.depth", "list of integers"]),
        ("Frame", put("depth", "shape", [4, 6.0]), ["spot3d.Frame.depth", "list of integers"]),
        ("Frame", put("depth", "shape", [0, 6]), ["spot3d.Frame.depth", "(h, w)"]),
        ("Frame", put("depth", "shape", [2**40, 2**40]), ["spot3d.Frame.depth", "limit"]),
        ("Frame", put("depth", "encoding", "png"), ["spot3d.Frame.depth", "png", "delta-zlib or palette or raw"]),
        ("Frame", put("depth", "encoding", "jpeg"), ["spot3d.Frame.depth", "jpeg", "delta-zlib or palette or raw"]),
        ("Frame", put("depth", "encoding", "delta-zlib"), ["spot3d.Frame.depth", "damaged"]),
        ("Frame", put("colour", "encoding", "jpeg"), ["spot3d.Frame.colour", "JPEG"]),
        ("Frame", put("depth", "data", "text"), ["spot3d.Frame.depth", "bin"]),
        ("Frame", lambda w: w["depth"].pop("data"), ["spot3d.Frame.depth", "lacks data"]),
        ("Frame", put("T_world_camera", [1.0] * 15), ["spot3d.Frame.T_world_camera", "16 numbers"]),
        ("Frame", put("T_world_camera", ["1"] * 16), ["spot3d.Frame.T_world_camera", "number"]),
        ("Frame", put("T_world_camera", [NAN] * 16), ["spot3d.Frame.T_world_camera", "finite"]),
        ("Frame", put("T_world_camera", MIRROR), ["spot3d.Frame.T_world_camera", "reflection"]),
        ("Frame", put("T_world_camera", STRETCHED), ["spot3d.Frame.T_world_camera", "orthonormal"]),
        ("Frame", put("T_world_camera", NO_BOTTOM), ["spot3d.Frame.T_world_camera", "bottom row"]),
        ("Frame", put("T_world_camera", [1e300] * 16), ["spot3d.Frame.T_world_camera", "orthonormal"]),
        ("Heat", put("heat", "shape", [6, 4]), ["spot3d.Heat.heat", "[6, 4]", "intrinsics"]),
        ("Heat", put("accepted", True), ["spot3d.Heat.accepted", "integer"]),
        ("Segments", put("intrinsics", None), ["spot3d.Segments", "intrinsics", "keyframe"]),
        ("Segments", put("keyframe", False), ["spot3d.Segments", "keyframe"]),
        ("Segments", put("labels", "shape", [6, 4]), ["spot3d.Segments", "[6, 4]", "[4, 6]"]),
        ("Segments", put("labels", "data", bytes(23) + b"\x03"), ["spot3d.Segments", "largest label is 3", "2 rows"]),
        ("Segments", put("heat", "data", b"\0\0\0\0\0\0\0\x40"), ["spot3d.Segments.heat", "[0, 1]"]),
        ("Segments", put("planes", "data", bytes(32)), ["spot3d.Segments.planes", "unit normal"]),
        ("Segments", put("planes", "dtype", "float32"), ["spot3d.Segments.planes", "float64"]),
        ("Segments", put("planes", "shape", [33, 4]), ["spot3d.Segments.planes", "32"]),
        ("Segments", put("stands_on", "data", b"\0\1"), ["spot3d.Segments", "stands_on", "1 planes"]),
        ("Segments", put("stands_on", "data", b"\0\xfe"), ["spot3d.Segments", "stands_on"]),
        ("Pose", put("T_world_camera", None), ["spot3d.Pose.T_world_camera", "16 numbers"]),
        ("Pose", put("corrected_ns", [5, 5]), ["spot3d.Pose.corrected_ns", "later"]),
        ("Pose", put("corrected_ns", [1, 2, 3]), ["spot3d.Pose", "2 corrections", "3 timestamps"]),
        ("Pose", put("corrected_ns", list(range(1025))), ["spot3d.Pose.corrected_ns", "1024"]),
        ("Pose", put("corrections", "data", b"\0\0\0\0\0\0\xf8\x7f" * 12), ["spot3d.Pose.corrections", "NaN"]),
        ("Pose", put("status", "fine"), ["spot3d.Pose.status", "lost", "fine"]),
        ("Proposals", put("boxes", "shape", [5, 3]), ["spot3d.Proposals.boxes", "(M, 5)"]),
        ("Proposals", put("boxes", "shape", [10_001, 5]), ["spot3d.Proposals.boxes", "10000"]),
        ("Proposals", put("boxes", "data", b"\xff" * 60), ["spot3d.Proposals.boxes", "finite"]),
        ("Objects", put("objects", 0, "rotation", [1.0] * 9), ["spot3d.Objects.objects.0.rotation"]),
        ("Objects", put("objects", 0, "size", [1, -1, 1]), ["spot3d.Objects.objects.0.size", "negative"]),
        ("Objects", put("objects", 0, "colour", [1, 2, 256]), ["spot3d.Objects.objects.0.colour.2", "256"]),
        ("Objects", put("objects", [{}]), ["spot3d.Objects.objects.0.id", "required"]),
        ("Objects", put("up", [0, 1]), ["spot3d.Objects.up", "3 numbers"]),
        ("Objects", put("map_limit_reached", 1), ["spot3d.Objects.map_limit_reached", "boolean"]),
        ("Segments", put("left_out", {"x" * 65: 1}), ["spot3d.Segments.left_out", "64"]),
        ("Objects", put("left_out", {str(i): i for i in range(65)}), ["spot3d.Objects.left_out", "64"]),
        ("Objects", put("left_out", {"x" * 65: 1}), ["spot3d.Objects.left_out", "64"]),
        ("Objects", put("left_out", "too large", -2), ["spot3d.Objects.left_out", "-2"]),
        ("Objects", put("keyframes_dropped", True), ["spot3d.Objects.keyframes_dropped", "integer"]),
        ("MapPoints", put("heat", "shape", [1]), ["spot3d.MapPoints.heat", "8 bytes"]),
        ("Progress", put("skipped", {str(i): i for i in range(65)}), ["spot3d.Progress.skipped", "64"]),
        ("Progress", put("skipped", {1: 1}), ["spot3d.Progress.skipped", "msgpack"]),
        ("Health", put("rate_hz", "30"), ["spot3d.Health.rate_hz", "number", "'30'"]),
        ("Health", put("last_error", "x" * 70_000), ["spot3d.Health.last_error", "65536"]),
    ],
)
def test_decode_names_the_field(name: str, edit: Callable[[Wire], None], texts: list[str]) -> None:
    wire = msgpack.unpackb(encode(SAMPLES[name]))
    edit(wire)
    with pytest.raises(CodecError) as caught:
        decode(msgpack.packb(wire), MESSAGES[name])
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 300
    for text in texts:
        assert text in message


def test_one_row_fewer_than_points_is_refused() -> None:
    wire = msgpack.unpackb(encode(SAMPLES["MapPoints"]))
    wire["heat"] = {"dtype": "float32", "shape": [1], "encoding": "raw", "data": bytes(4)}
    with pytest.raises(CodecError, match=r"spot3d\.MapPoints\.heat: has 1 rows, but xyz has 2"):
        decode(msgpack.packb(wire), MESSAGES["MapPoints"])


@pytest.mark.parametrize(
    ("payload", "text"),
    [
        (b"", "expected a msgpack map"),
        (b"\x01", "expected a msgpack map"),
        (b"\x80\x80", "1 bytes follow"),
        (b"\x81\x01\x01", "keys must be strings"),
        (b"\x81\xa1", "truncated"),
        (b"\x82\xa1a\x01\xa1a\x01", "occurs twice"),
        (b"\x81\xa1a\xc1", "not msgpack"),
        (b"\x81\xa1\xff\x01", "UTF-8"),
        (b"\x81\xa1a\xc6\xff\xff\xff\xff", "truncated"),
        (b"\xdf\xff\xff\xff\xff", "limit of 64"),
        (b"\x81\xa1a\xdd\xff\xff\xff\xff", "more values"),
    ],
)
def test_bytes_that_are_no_map(payload: bytes, text: str) -> None:
    with pytest.raises(CodecError, match=text):
        decode(payload, Pose)


@pytest.mark.parametrize(("stated", "ok"), [("1.0", True), ("1.7", True), ("2.0", False), ("0.9", False)])
def test_version(stated: str, ok: bool) -> None:
    wire = msgpack.unpackb(encode(SAMPLES["Pose"]))
    wire["header"]["version"] = stated
    if ok:
        assert decode(msgpack.packb(wire), Pose) == SAMPLES["Pose"]
        return
    with pytest.raises(CodecError) as caught:
        decode(msgpack.packb(wire), Pose)
    for text in ("spot3d.Pose.header.version", stated, Pose.VERSION, "1.x"):
        assert text in str(caught.value)


def test_version_is_refused_before_the_fields_are_looked_at() -> None:
    wire = {"header": {"schema": "spot3d.Pose", "version": "2.0"}, "T_world_camera": "new"}
    with pytest.raises(CodecError, match=r"version 2\.0.*1\.x"):
        decode(msgpack.packb(wire), Pose)


def test_fields_of_a_newer_minor_version_are_ignored() -> None:
    wire = msgpack.unpackb(encode(SAMPLES["Objects"]))
    wire["header"] |= {"version": "1.9", "clock": "ptp"}
    wire["objects"][0]["mass"] = 0.3
    wire["normals"] = {"dtype": "float16", "shape": [10**9], "encoding": "new", "data": bytes(3_000_000)}
    assert decode(msgpack.packb(wire), MESSAGES["Objects"]) == SAMPLES["Objects"]


def test_fields_that_an_older_minor_version_lacks_are_empty() -> None:
    wire = msgpack.unpackb(encode(SAMPLES["Objects"]))
    assert wire["header"]["version"] == "1.2"
    wire["header"]["version"] = "1.0"
    del wire["left_out"], wire["keyframes_dropped"], wire["epoch"], wire["header"]["stream"], wire["header"]["sender"]
    read = decode(msgpack.packb(wire), Objects)
    assert (read.left_out, read.keyframes_dropped, read.epoch) == ({}, 0, None)
    assert (read.header.stream, read.header.sender) == (None, None)
    assert len(read.objects) == 1


@pytest.mark.parametrize("name", ["Frame", "Heat"])
def test_a_frame_of_an_older_sender_states_no_noise(name: str) -> None:
    wire = msgpack.unpackb(encode(SAMPLES[name]))
    assert wire["header"]["version"] == "1.1"
    wire["header"]["version"] = "1.0"
    del wire["depth_noise"]
    assert decode(msgpack.packb(wire), type(SAMPLES[name])).depth_noise is None
    wire["depth_noise"] = {"model": "quadratic", "floor": 0.0, "growth": 0.001, "at": 0.4}
    with pytest.raises(CodecError, match=r"depth_noise\.floor: input should be greater than or equal to 0\.000001"):
        decode(msgpack.packb(wire), type(SAMPLES[name]))
    wire["depth_noise"] |= {"floor": 0.001, "growth": 0.1, "at": 8.0}
    with pytest.raises(CodecError, match=r"depth_noise: 4\.901 m at 1 m is implausibly large .* give it in metres"):
        decode(msgpack.packb(wire), type(SAMPLES[name]))


def test_segments_of_an_older_sender_leave_nothing_out() -> None:
    wire = msgpack.unpackb(encode(SAMPLES["Segments"]))
    del wire["left_out"]
    assert decode(msgpack.packb(wire), Segments).left_out == {}


def test_encoding_names_schema_and_major_version() -> None:
    assert encoding(Frame) == "application/msgpack;schema=spot3d.Frame/1"
    refuse_encoding(encoding(Frame), Frame)


@pytest.mark.parametrize("stated", ["", "zenoh/bytes", encoding(Heat), encoding(Frame)[:-1] + "2"])
def test_another_encoding_is_refused_with_both_names(stated: str) -> None:
    with pytest.raises(CodecError) as caught:
        refuse_encoding(stated, Frame)
    assert repr(stated) in str(caught.value)
    assert encoding(Frame) in str(caught.value)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Proposals.model_validate({"header": HEADER, "boxes": []}), "boxes"),
        (lambda: Proposals(header=HEADER, boxes=np.zeros((1, 5))), "boxes"),
        (lambda: Proposals(header=HEADER, boxes=np.zeros((1, 5), ">f4")), "boxes"),
        (
            lambda: Frame(
                **(rgbd() | {"depth_scale": 0.001, "depth": np.ones((4, 6), np.float32)}), T_world_camera=None
            ),
            "depth",
        ),
        (lambda: Frame(**rgbd(), T_world_camera=np.eye(3)), "T_world_camera"),
        (lambda: Pose(**{**dict(SAMPLES["Pose"]), "bend": np.full((4, 6), 0.2)}), "reaches 0.2"),
        (lambda: Header(robot="a b", seq=0, stamp_ns=0, frame_id="c"), "robot"),
    ],
)
def test_wrong_messages_cannot_be_made(make: Callable[[], object], field: str) -> None:
    with pytest.raises(ValidationError, match=field):
        make()


def test_long_texts_are_cut_not_refused() -> None:
    pose = Pose(header=HEADER, T_world_camera=quarter_turn(), status="lost", reason="x" * 5000, provider="kiss")
    assert pose.reason == "x" * 1000


def test_the_trace_keeps_the_newest_hops() -> None:
    header = HEADER
    for n in range(20):
        header = header.with_hop("pose", n, n + 1)
    assert [hop.received_ns for hop in header.trace] == list(range(4, 20))
    assert len(HEADER.trace) == 1


def test_messages_are_frozen_and_comparable() -> None:
    pose = SAMPLES["Pose"]
    with pytest.raises(ValidationError, match="frozen"):
        pose.header = HEADER
    assert pose != SAMPLES["Frame"]
    assert SAMPLES["Frame"] != Frame(**rgbd(), T_world_camera=None)


def test_jpeg_without_opencv_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(CodecError, match=r"spot3d\.Frame\.colour: .*OpenCV.*pip install"):
        encode(SAMPLES["Frame"], thin_link=True)
