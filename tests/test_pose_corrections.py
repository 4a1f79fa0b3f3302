"""What the poses of earlier frames lack, as it is looked up and sent."""

import numpy as np
import pytest

from spot3d.dataflow.conversion import camera_pose, corrections_message
from spot3d.pose_corrections import PoseCorrections
from spot3d.trajectory import rotation_from_vector
from spot3d_schemas import Header, Pose, decode, encode

SINCE = 1_764_000_000_000_000_000
CORRECTIONS = PoseCorrections(
    np.array((SINCE, SINCE + 600, SINCE + 1800)),
    np.array((np.arange(6.0), np.arange(6.0) + 3.0, np.zeros(6))),
)


@pytest.mark.parametrize(("after", "found"), [(0, 0.0), (200, 1.0), (600, 3.0), (1200, 1.5)])
def test_in_between_poses_are_off_in_line(after: int, found: float) -> None:
    """To the nanosecond, though stamps since 1970 are larger than what a float tells apart."""
    twist = CORRECTIONS.at(SINCE + after)
    assert twist is not None
    assert twist[0] == pytest.approx(found)


def test_after_the_last_one_it_is_as_there_and_before_the_first_one_nothing_is_known() -> None:
    last = PoseCorrections(CORRECTIONS.stamps_ns[:2], CORRECTIONS.twists[:2])
    np.testing.assert_allclose(last.at(SINCE + 10**9), np.arange(6.0) + 3.0)
    assert CORRECTIONS.at(SINCE - 1) is None


def test_in_other_axes_shift_and_rotation_are_turned() -> None:
    rotation = rotation_from_vector(np.array((0.3, -0.2, 0.9)))
    there = CORRECTIONS.seen_from(rotation)
    for half in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(rotation @ there.twists[1, half], CORRECTIONS.twists[1, half], atol=1e-12)
    np.testing.assert_array_equal(there.stamps_ns, CORRECTIONS.stamps_ns)


def test_they_are_sent_along_with_a_pose() -> None:
    fields = {
        "header": Header(robot="r", seq=0, stamp_ns=SINCE, frame_id="world").with_hop("pose", 1, 2),
        "T_world_camera": np.eye(4),
        "status": "ok",
        "reason": "",
        "provider": "given",
    }
    sent = decode(encode(Pose(**fields, **corrections_message(CORRECTIONS))), Pose)
    received = camera_pose(sent).corrections
    assert received is not None
    np.testing.assert_array_equal(received.stamps_ns, CORRECTIONS.stamps_ns)
    np.testing.assert_allclose(received.twists, CORRECTIONS.twists)
    assert camera_pose(Pose(**fields, **corrections_message(None))).corrections is None
