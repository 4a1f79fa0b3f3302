"""True objects carried into a bent world by the frames that see them; boxes judged in either world."""

import numpy as np
import pytest
from table_frame import CAMERA, T_WORLD_CAMERA, Block, table_depth

from spot3d.boxes import Box3D, moved
from spot3d.evaluate.carried import Sightings
from spot3d.evaluate.judgement import Found, judge, that_count
from spot3d.evaluate.points import IGNORED
from spot3d.evaluate.truth import LabelledScene
from spot3d.pose_corrections import PoseCorrections

APART = 2.0
BLOCK: Block = ((-0.10, -0.05, 0.0), (0.10, 0.05, 0.12))
UP = np.array((0.0, 0.0, 1.0))


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = (x, y, z)
    return T


def along(block: Block, x: float) -> Block:
    low, high = ((corner[0] + x, *corner[1:]) for corner in block)
    return low, high


def surface(block: Block) -> np.ndarray:
    """Points on the front and the top of a block, 1 cm apart."""
    (x0, y0, z0), (x1, y1, z1) = block
    x = np.arange(x0, x1, 0.01)
    front = np.stack(np.meshgrid(x, [y0], np.arange(z0, z1, 0.01)), axis=-1).reshape(-1, 3)
    top = np.stack(np.meshgrid(x, np.arange(y0, y1, 0.01), [z1]), axis=-1).reshape(-1, 3)
    return np.concatenate((front, top))


def box_of(block: Block) -> Box3D:
    low, high = np.array(block)
    return Box3D((low + high) / 2, high - low, np.eye(3))


def scene(blocks: tuple[Block, ...], labelled: bool = True) -> LabelledScene:
    """Blocks on a table, with a patch of table beside each."""
    parts = [surface(block) for block in blocks]
    labels = [np.full(len(part), number, np.uint8) for number, part in enumerate(parts, start=1)]
    for block in blocks:
        parts.append(np.array([block[0], block[1]]) * (1, 1, 0) + (0, 0.2, 0))
        labels.append(np.zeros(2, np.uint8))
    xyz, label = np.concatenate(parts).astype(np.float32), np.concatenate(labels)
    if not labelled:
        xyz, label = np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
    numbers = tuple(range(1, len(blocks) + 1))
    return LabelledScene(tuple(map(str, numbers)), numbers, tuple(map(box_of, blocks)), UP, xyz, label)


BLOCKS = (BLOCK, along(BLOCK, APART))


@pytest.mark.parametrize("labelled", [True, False])
def test_each_object_goes_where_the_frames_that_see_it_are(labelled: bool) -> None:
    """The run's world is right at the first block and 4 cm too high at the second, as a drifting path bends it."""
    truth = scene(BLOCKS, labelled)
    sightings = Sightings(truth)
    bend = shifted(y=0.01, z=0.04)
    for block, error in ((0, np.eye(4)), (1, bend)):
        for step in (-0.1, 0.0, 0.1):
            pose = shifted(x=block * APART + step) @ T_WORLD_CAMERA
            depth, _ = table_depth(BLOCKS, pose)
            sightings.add(depth, CAMERA, pose, error @ pose)
    # One frame is far off: the median does not follow it.
    sightings.add(table_depth(BLOCKS)[0], CAMERA, T_WORLD_CAMERA, shifted(x=0.5) @ T_WORLD_CAMERA)
    first, second = sightings.transforms(shifted(x=9))
    np.testing.assert_allclose(first, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(second, bend, atol=1e-9)

    carried, found = sightings.carried(shifted(x=9)), [truth.boxes[0], moved(truth.boxes[1], bend)]
    np.testing.assert_allclose(np.diag(judge(found, carried).iou), 1, atol=1e-6)
    assert judge(found, truth).iou[1, 1] < 0.6
    if labelled:
        # The points lie on the boxes' faces, where rounding decides.
        grown = [Box3D(box.centre, box.size + 0.002, box.rotation) for box in found]
        assert judge(grown, carried).points.f_measure == pytest.approx(100)
        table = carried.xyz[carried.label == 0]
        np.testing.assert_allclose(table[:, 2], [0, 0, 0.04, 0.04], atol=1e-6, err_msg="the table goes along")


def test_objects_are_carried_to_where_the_map_of_poses_is_known_to_lie_in_the_end() -> None:
    """The map slides by 1 cm with each frame, and with it all that was seen before."""
    sightings, depth = Sightings(scene(BLOCKS[:1])), table_depth(BLOCKS)[0]
    for step in range(4):
        slid = shifted(y=0.01 * step)
        sightings.add(depth, CAMERA, T_WORLD_CAMERA, slid @ T_WORLD_CAMERA, slid)
    np.testing.assert_allclose(sightings.transforms(shifted(x=9))[0], shifted(y=0.03), atol=1e-9)


def test_objects_are_carried_by_what_is_known_in_the_end_of_the_poses() -> None:
    """Poses are 1 cm off each, further with each frame; the last two of four come to be known, and then all but one."""
    sightings, depth = Sightings(scene(BLOCKS[:1])), table_depth(BLOCKS)[0]
    off = 0.01 * np.arange(4)
    for step, wrong in enumerate(off):
        sightings.add(depth, CAMERA, T_WORLD_CAMERA, shifted(y=wrong) @ T_WORLD_CAMERA, stamp_ns=step)
    twists = np.zeros((4, 6))
    twists[:, 1] = -off
    for known in (twists[1:] * 0.5, twists[1:]):
        sightings.correct(PoseCorrections(np.arange(1, 4), known))
    sightings.correct(PoseCorrections(np.arange(2, 4), twists[2:] + np.eye(6)[1] * 0.02))
    np.testing.assert_allclose(sightings.transforms(shifted(x=9))[0], shifted(y=0.01), atol=1e-9)


def test_what_no_frame_sees_goes_with_the_whole() -> None:
    truth, whole = scene(BLOCKS), shifted(z=0.3)
    sightings = Sightings(truth)
    depth, _ = table_depth(BLOCKS)
    hidden = np.where(depth > 0, np.float32(0.3), depth)
    for seen in (hidden, np.zeros_like(depth)):
        sightings.add(seen, CAMERA, T_WORLD_CAMERA, shifted(y=1) @ T_WORLD_CAMERA)
    for T in sightings.transforms(whole):
        np.testing.assert_array_equal(T, whole)
    np.testing.assert_allclose(sightings.carried(whole).xyz, truth.xyz + np.array((0, 0, 0.3)), atol=1e-6)
    nothing = LabelledScene((), (), (), UP, truth.xyz[:3], truth.label[:3])
    np.testing.assert_allclose(Sightings(nothing).carried(whole).xyz[:, 2], truth.xyz[:3, 2] + 0.3, atol=1e-6)


def test_boxes_on_ignored_points_are_left_out() -> None:
    def box(x: float) -> Box3D:
        return Box3D(np.array((x, 0.0, 0.0)), np.ones(3), np.eye(3))

    xyz = np.array([[0, 0, 0], [0.1, 0, 0], [3, 0, 0], [3.1, 0, 0], [3.2, 0, 0]], np.float32)
    label = np.array([1, 0, IGNORED, IGNORED, 0], np.uint8)
    truth = LabelledScene(("mug",), (1,), (box(0),), UP, xyz, label)
    assert [len(that_count([box(x)], truth)) for x in (0.0, 3.0, 9.0)] == [1, 0, 1]
    judged = judge([box(0), box(3), box(9)], truth)
    assert (len(judged.boxes), judged.left_out, judged.iou.shape) == (2, 1, (1, 2))
    assert judged.success_of_all() == (1, 3)


def test_found_boxes_move_with_their_points() -> None:
    turn = np.array([[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], np.float64)
    found = Found((box_of(BLOCK),), (np.array([[1.0, 0, 0]]),)).moved(turn)
    np.testing.assert_allclose(found.points[0], [[1, 1, 0]])
    np.testing.assert_allclose(found.boxes[0].centre, [1, 0, 0.06], atol=1e-12)
