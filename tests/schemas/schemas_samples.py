"""Messages for the contract's tests: one small sample of each, and strategies for arbitrary ones."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from spot3d_schemas import (
    About,
    CameraIntrinsics,
    DepthNoise,
    End,
    Frame,
    Header,
    Health,
    Heat,
    Hop,
    MapChanges,
    MapPoints,
    Message,
    Object3D,
    Objects,
    Pose,
    Preview,
    Progress,
    Proposals,
    Segments,
)
from spot3d_schemas.limits import BEND_SHAPE, MAX_BEND

HEADER = Header(
    robot="drone", seq=7, stamp_ns=1_700_000_000_123_456_789, frame_id="camera", stream="a1", sender="b2"
).with_hop("source", 1, 2)


def rgbd(height: int = 4, width: int = 6, dtype: Any = np.uint16) -> dict[str, Any]:
    """The fields that Frame and Heat share, for a smooth synthetic image."""
    ramp = np.arange(height * width).reshape(height, width)
    return {
        "header": HEADER,
        "intrinsics": CameraIntrinsics(fx=5.0, fy=5.5, cx=2.0, cy=1.0, width=width, height=height),
        "depth_scale": 0.001 if dtype == np.uint16 else 1.0,
        "colour": np.repeat((ramp % 256).astype(np.uint8)[:, :, None], 3, axis=2),
        "depth": (1000 + ramp % 3000).astype(dtype),
        "depth_noise": DepthNoise(floor=0.0003, growth=0.0036, at=0.0),
    }


def quarter_turn() -> np.ndarray:
    """A rigid transform (4, 4)."""
    return np.array([[0.0, -1, 0, 0.5], [1, 0, 0, -2], [0, 0, 1, 3], [0, 0, 0, 1]])


BOX = Object3D(
    id=3,
    confidence=0.5,
    views=12,
    centre=np.array([0.1, 0.2, 0.3]),
    size=np.array([0.1, 0.1, 0.2]),
    rotation=np.eye(3),
    points=400,
    colour=(10, 20, 30),
)

SAMPLES: dict[str, Message] = {
    "Frame": Frame(**rgbd(), T_world_camera=quarter_turn()),
    "Preview": Preview(header=HEADER, **{name: rgbd()[name] for name in ("intrinsics", "colour")}),
    "End": End(header=HEADER, frames_sent=300),
    "Pose": Pose(
        header=HEADER,
        T_world_camera=quarter_turn(),
        status="lost",
        reason="the view matches the map in two places",
        provider="kiss-icp",
        epoch="c3",
        lost_since_ns=1_700_000_000_000_000_000,
        T_world_map=quarter_turn(),
        depth_factor=0.98,
        delay_s=0.033,
        turn=np.array([0.01, -0.02, 0.0]),
        centre=np.array([0.0, 0.03]),
        bend=np.linspace(-0.01, 0.01, 24).reshape(4, 6),
        corrected_ns=(1_699_999_998_000_000_000, 1_699_999_999_000_000_000),
        corrections=np.array([[0.01, -0.02, 0.0, 0.001, 0.0, -0.002], [0.0, 0.01, 0.0, 0.0, 0.003, 0.0]]),
    ),
    "Proposals": Proposals(header=HEADER, boxes=np.arange(15, dtype=np.float32).reshape(3, 5)),
    "Heat": Heat(**rgbd(), heat=np.full((4, 6), 255, np.uint8), accepted=1, masked=2, rejected=3),
    "Segments": Segments(
        header=HEADER,
        keyframe=True,
        intrinsics=CameraIntrinsics(fx=5.0, fy=5.5, cx=2.0, cy=1.0, width=6, height=4),
        labels=(np.arange(24, dtype=np.uint8) % 3).reshape(4, 6),
        heat=np.array([0.25, 1.0], np.float32),
        planes=np.array([[0.0, -0.6, -0.8, 1.2]]),
        stands_on=np.array([0, -1], np.int8),
        left_out={"too low in a keyframe": 4},
    ),
    "Objects": Objects(
        header=HEADER,
        objects=(BOX,),
        up=np.array([0.0, 0, 1]),
        frame_count=9,
        map_points=1000,
        map_limit_reached=False,
        complete=False,
        left_out={"too large": 2},
        keyframes_dropped=20,
        epoch="d4",
    ),
    "MapPoints": MapPoints(
        header=HEADER,
        xyz=np.ones((2, 3), np.float32),
        rgb=np.full((2, 3), 9, np.uint8),
        heat=np.array([0.25, 0.5], np.float32),
        frequency=np.array([5, 6], np.uint32),
        total=20,
        epoch="d4",
    ),
    "MapChanges": MapChanges(
        header=HEADER,
        generation=1_700_000_000_123_456_789,
        cursor=40,
        behind=3,
        number=np.array([7, 9], np.uint32),
        xyz=np.ones((2, 3), np.float32),
        rgb=np.full((2, 3), 9, np.uint8),
        heat=np.array([64, 0], np.uint8),
        frequency=np.array([5, 0], np.uint32),
        planes=np.array([[0.0, -0.6, -0.8, 1.2]]),
        total=20,
        epoch="d4",
    ),
    "Progress": Progress(header=HEADER, fused=5, skipped={"pose lost": 2}, last_stamp_ns=77, complete=True),
    "Health": Health(
        header=HEADER,
        stage="fusion",
        pid=1,
        uptime_s=2.5,
        received=3,
        published=4,
        drops={"late": 1},
        events={"intrinsics changed": 1},
        errors=0,
        last_error="",
        rate_hz=29.9,
        latency_ms_p50=-0.5,
        latency_ms_p99=8.0,
        step_ms_p50=None,
        step_ms_p99=None,
        cpu_s=1.0,
        rss_bytes=10**9,
        threads=4,
        state="two processes of the stage fusion",
        sent={"fusion/progress": 3},
        sent_bytes={"fusion/progress": 600},
    ),
    "About": About(
        header=HEADER,
        stage="pose",
        pid=1,
        host="drone",
        spot3d="0.1.0",
        zenoh="1.10.2",
        python="3.11.7",
        time_ns=5,
        kernels_missing=2,
        shared_memory_bytes=10**8,
        disk="/var/lib",
        disk_free_bytes=10**10,
        certificate_until_ns=None,
    ),
}

_counts = st.integers(0, 2**63 - 1)
_names = st.text(
    st.characters(codec="utf-8", exclude_characters="/*$#?@", exclude_categories=["Z", "C"]),
    min_size=1,
    max_size=16,
)
_finite = st.floats(allow_nan=False, allow_infinity=False)
_non_negative = st.floats(0, allow_nan=False, allow_infinity=False)
_small = st.floats(1e-6, 0.05)
_positive = st.floats(0, exclude_min=True, allow_nan=False, allow_infinity=False)
_texts = st.text(max_size=50)
_reasons = st.dictionaries(st.text(max_size=16), _counts, max_size=4)
_vectors = hnp.arrays(np.float64, 3, elements=_finite)


def _rotation(axis_angle: np.ndarray) -> np.ndarray:
    """Rodrigues' formula, plain."""
    angle = float(np.linalg.norm(axis_angle))
    x, y, z = axis_angle / angle if angle > 1e-6 else (0.0, 0.0, 1.0)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


_rotations = hnp.arrays(np.float64, 3, elements=st.floats(-4, 4)).map(_rotation)


@st.composite
def _transforms(draw: st.DrawFn) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = draw(_rotations)
    T[:3, 3] = draw(_vectors)
    return T


_hops = st.builds(Hop, stage=_names, received_ns=_counts, sent_ns=_counts)
_headers = st.builds(
    Header,
    robot=_names,
    seq=_counts,
    stamp_ns=_counts,
    frame_id=_names,
    trace=st.lists(_hops, max_size=3).map(tuple),
    stream=st.none() | _names,
    sender=st.none() | _names,
)


@st.composite
def _rgbd(draw: st.DrawFn) -> dict[str, Any]:
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    dtype = draw(st.sampled_from([np.uint16, np.float32]))
    return {
        "header": draw(_headers),
        "intrinsics": CameraIntrinsics(
            fx=draw(_positive),
            fy=draw(_positive),
            cx=draw(_finite),
            cy=draw(_finite),
            width=width,
            height=height,
        ),
        "depth_scale": draw(_positive) if dtype == np.uint16 else 1.0,
        "colour": draw(hnp.arrays(np.uint8, (height, width, 3))),
        "depth": draw(hnp.arrays(dtype, (height, width))),
        "depth_noise": draw(st.none() | st.builds(DepthNoise, floor=_small, growth=_small, at=st.floats(0, 1))),
    }


@st.composite
def _frames(draw: st.DrawFn) -> Frame:
    return Frame(**draw(_rgbd()), T_world_camera=draw(st.none() | _transforms()))


@st.composite
def _heats(draw: st.DrawFn) -> Heat:
    fields = draw(_rgbd())
    heat = draw(hnp.arrays(np.uint8, fields["depth"].shape))
    return Heat(**fields, heat=heat, accepted=draw(_counts), masked=draw(_counts), rejected=draw(_counts))


@st.composite
def _segments(draw: st.DrawFn) -> Segments:
    if not draw(st.booleans()):
        return Segments(
            header=draw(_headers),
            keyframe=False,
            intrinsics=None,
            labels=np.zeros((0, 0), np.uint8),
            heat=np.zeros(0, np.float32),
            planes=np.zeros((0, 4)),
            stands_on=np.zeros(0, np.int8),
        )
    count, planes = draw(st.integers(0, 4)), draw(st.integers(0, 3))
    intrinsics = draw(_rgbd())["intrinsics"]
    surfaces = [np.append(draw(_rotations)[0], draw(_finite)) for _ in range(planes)]
    return Segments(
        header=draw(_headers),
        keyframe=True,
        intrinsics=intrinsics,
        labels=draw(hnp.arrays(np.uint8, intrinsics.shape, elements=st.integers(0, count))),
        heat=draw(hnp.arrays(np.float32, count, elements=st.floats(0, 1, width=32))),
        planes=np.array(surfaces, np.float64).reshape(-1, 4),
        stands_on=draw(hnp.arrays(np.int8, count, elements=st.integers(-1, planes - 1))),
        left_out=draw(_reasons),
    )


@st.composite
def _map_points(draw: st.DrawFn) -> MapPoints:
    n = draw(st.integers(0, 5))
    return MapPoints(
        header=draw(_headers),
        xyz=draw(hnp.arrays(np.float32, (n, 3))),
        rgb=draw(hnp.arrays(np.uint8, (n, 3))),
        heat=draw(hnp.arrays(np.float32, n)),
        frequency=draw(hnp.arrays(np.uint32, n)),
        total=draw(_counts),
        epoch=draw(st.none() | _names),
    )


@st.composite
def _map_changes(draw: st.DrawFn) -> MapChanges:
    n, planes = draw(st.integers(0, 5)), draw(st.integers(0, 3))
    surfaces = [np.append(draw(_rotations)[0], draw(_finite)) for _ in range(planes)]
    return MapChanges(
        header=draw(_headers),
        generation=draw(_counts),
        cursor=draw(_counts),
        behind=draw(_counts),
        number=draw(hnp.arrays(np.uint32, n)),
        xyz=draw(hnp.arrays(np.float32, (n, 3))),
        rgb=draw(hnp.arrays(np.uint8, (n, 3))),
        heat=draw(hnp.arrays(np.uint8, n)),
        frequency=draw(hnp.arrays(np.uint32, n)),
        planes=np.array(surfaces, np.float64).reshape(-1, 4),
        total=draw(_counts),
        epoch=draw(st.none() | _names),
    )


@st.composite
def _previews(draw: st.DrawFn) -> Preview:
    fields = draw(_rgbd())
    return Preview(**{name: fields[name] for name in ("header", "intrinsics", "colour")})


_boxes = st.integers(0, 5).flatmap(
    lambda m: hnp.arrays(np.float32, (m, 5), elements=st.floats(allow_nan=False, allow_infinity=False, width=32))
)
_objects = st.builds(
    Object3D,
    id=_counts,
    confidence=_non_negative,
    views=_counts,
    centre=_vectors,
    size=hnp.arrays(np.float64, 3, elements=_non_negative),
    rotation=_rotations,
    points=_counts,
    colour=st.tuples(*[st.integers(0, 255)] * 3),
)


@st.composite
def _poses(draw: st.DrawFn) -> Pose:
    stamps = draw(st.sets(_counts, max_size=3).map(sorted))
    twists = hnp.arrays(np.float64, (len(stamps), 6), elements=_finite)
    fields = st.builds(
        dict,
        header=_headers,
        T_world_camera=_transforms(),
        status=st.sampled_from(["ok", "lost"]),
        reason=_texts,
        provider=_names,
        epoch=st.none() | _names,
        lost_since_ns=st.none() | _counts,
        T_world_map=st.none() | _transforms(),
        depth_factor=st.floats(0.5, 2.0),
        delay_s=_finite,
        turn=st.none() | hnp.arrays(np.float64, 3, elements=_finite),
        centre=st.none() | hnp.arrays(np.float64, 2, elements=_finite),
        bend=st.none() | hnp.arrays(np.float64, BEND_SHAPE, elements=st.floats(-MAX_BEND, MAX_BEND)),
    )
    return Pose(**draw(fields), corrected_ns=tuple(stamps), corrections=draw(twists))


MESSAGES_OF: dict[str, st.SearchStrategy[Message]] = {
    "Frame": _frames(),
    "Preview": _previews(),
    "End": st.builds(End, header=_headers, frames_sent=_counts),
    "Pose": _poses(),
    "Proposals": st.builds(Proposals, header=_headers, boxes=_boxes),
    "Heat": _heats(),
    "Segments": _segments(),
    "Objects": st.builds(
        Objects,
        header=_headers,
        objects=st.lists(_objects, max_size=3).map(tuple),
        up=_vectors,
        frame_count=_counts,
        map_points=_counts,
        map_limit_reached=st.booleans(),
        complete=st.booleans(),
        left_out=_reasons,
        keyframes_dropped=_counts,
        epoch=st.none() | _names,
    ),
    "MapPoints": _map_points(),
    "MapChanges": _map_changes(),
    "Progress": st.builds(
        Progress,
        header=_headers,
        fused=_counts,
        skipped=_reasons,
        last_stamp_ns=_counts,
        complete=st.booleans(),
    ),
    "Health": st.builds(
        Health,
        header=_headers,
        stage=_names,
        pid=_counts,
        uptime_s=_non_negative,
        received=_counts,
        published=_counts,
        drops=_reasons,
        events=_reasons,
        errors=_counts,
        last_error=_texts,
        rate_hz=st.none() | _non_negative,
        latency_ms_p50=st.none() | _finite,
        latency_ms_p99=st.none() | _finite,
        step_ms_p50=st.none() | _non_negative,
        step_ms_p99=st.none() | _non_negative,
        cpu_s=_non_negative,
        rss_bytes=_counts,
        threads=_counts,
        state=_texts,
        sent=_reasons,
        sent_bytes=_reasons,
    ),
    "About": st.builds(
        About,
        header=_headers,
        stage=_names,
        pid=_counts,
        host=_texts,
        spot3d=_texts,
        zenoh=_texts,
        python=_texts,
        time_ns=_counts,
        kernels_missing=_counts,
        shared_memory_bytes=_counts,
        disk=_texts,
        disk_free_bytes=_counts,
        certificate_until_ns=st.none() | _counts,
    ),
}
