"""Things without depth on their sides, which shine or are dark: how far they reach."""

from dataclasses import replace

import numpy as np
import pytest
from fusion_room import CAMERA, ROOM, Cuboid, orbit, standing
from numpy.typing import NDArray
from voting_room import SETTINGS, keyframe, overlaps

from spot3d.calibration import Calibration
from spot3d.camera import back_project
from spot3d.found_object import FoundObject
from spot3d.fusion.objects.consensus import ViewConsensus
from spot3d.fusion.objects.keyframes import Keyframe
from spot3d.fusion.objects.outline import OUTERMOST, outline_of

CARTON = standing(0.0, 0.0, (0.12, 0.16, 0.2), 0.3)
SMALL = standing(0.4, 0.1, (0.12, 0.12, 0.1), 0.0, (40, 160, 60))
THINGS = (CARTON, SMALL)
LAMP = Cuboid((0.0, 0.0, 0.5), (0.2, 0.2, 0.1), 0.3)


def world(frame: Keyframe) -> NDArray[np.float64]:
    """(h, w, 3) points of a keyframe."""
    T = frame.T_map_camera
    return np.asarray(back_project(frame.depth, CAMERA) @ T[:3, :3].T + T[:3, 3])


def torn(frame: Keyframe, below: float, label: int = 1) -> Keyframe:
    """The keyframe without the depth that one thing has below a height above the table."""
    gone = (frame.labels == label) & (world(frame)[..., 2] < below)
    return replace(frame, depth=np.where(gone, np.float32(0), frame.depth))


def found(frames: list[Keyframe]) -> list[FoundObject]:
    return ViewConsensus(SETTINGS).update(frames).objects


def carton_in(frames: list[Keyframe]) -> tuple[float, FoundObject]:
    """IoU of the carton with its best box, and that object."""
    objects = found(frames)
    iou = overlaps(objects, (CARTON,))[0]
    return float(iou.max()), objects[int(iou.argmax())]


def views(count: int = 12, things: tuple[Cuboid, ...] = THINGS) -> list[Keyframe]:
    return [keyframe(pose, things, number=number) for number, pose in enumerate(orbit(count))]


@pytest.mark.parametrize("count", [1, 12])
def test_what_has_depth_on_its_top_alone_stands_on_the_table_where_its_outline_does(count: int) -> None:
    above = 0.19  # only the lid
    frames = [torn(frame, above) for frame in views(count)]
    iou, box = carton_in(frames)
    assert iou > 0.5
    assert box.box.size[2] == pytest.approx(CARTON.size[2], abs=0.03)
    assert box.box.centre[2] == pytest.approx(CARTON.centre[2], abs=0.02)
    without = ViewConsensus(SETTINGS.model_copy(update={"skipped": ("outline",)})).update(frames).objects
    assert overlaps(without, (CARTON,)).max(initial=0.0) < iou - 0.2


def test_a_thing_that_some_views_see_whole_has_the_box_that_they_see() -> None:
    whole = views()
    some = [torn(frame, 0.19) if number % 3 == 0 else frame for number, frame in enumerate(whole)]
    before, after = carton_in(whole)[1].box, carton_in(some)[1].box
    assert np.abs(before.size - after.size).max() < 0.01
    assert np.abs(before.centre - after.centre).max() < 0.01


def test_a_torn_thing_leaves_the_others_as_they_are() -> None:
    whole = views()
    both = found([torn(frame, 0.19) for frame in whole])
    assert overlaps(both, (SMALL,)).max() == pytest.approx(overlaps(found(whole), (SMALL,)).max(), abs=1e-6)


@pytest.mark.parametrize("label", [1, 2])
def test_what_has_its_depth_has_no_outline(label: int) -> None:
    outline = outline_of(views(1)[0], label)
    assert outline.shape == (OUTERMOST, 3)
    assert np.isnan(outline).all()


def test_where_nothing_is_known_to_support_there_is_no_outline() -> None:
    frame = torn(views(1)[0], 0.19)
    nowhere = replace(frame, planes=np.zeros((0, 4)), stands_on=np.full(2, -1, np.int8))
    assert np.isfinite(outline_of(frame, 1)).all()
    assert np.isnan(outline_of(nowhere, 1)).all()


def test_what_hangs_in_the_air_does_not_reach_down_to_the_table() -> None:
    frame = torn(keyframe(orbit(1)[0], (LAMP,)), 0.53)
    assert frame.stands_on[0] == -1
    assert np.isnan(outline_of(frame, 1)).all()


def test_a_thing_without_any_depth_has_no_outline() -> None:
    assert np.isnan(outline_of(torn(views(1)[0], 1.0), 1)).all()


@pytest.mark.parametrize("roll", [0.0, np.pi / 2, np.pi])
def test_the_foot_is_found_however_the_camera_is_rolled(roll: float) -> None:
    c, s = np.cos(roll), np.sin(roll)
    turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
    frame = torn(keyframe(orbit(1)[0] @ turn, (CARTON,), room=ROOM), 0.19)
    T = frame.T_map_camera
    outline = outline_of(frame, 1) @ T[:3, :3].T + T[:3, 3]
    assert outline[:, 2].min() == pytest.approx(0, abs=0.01)
    assert np.abs(outline[:, :2]).max() < 0.15


def test_where_the_image_ends_a_thing_does_not_stand() -> None:
    """The lowest row that is left of the thing is not its foot."""
    frame = torn(views(1, (CARTON,))[0], 0.19)
    v, _ = np.nonzero(frame.labels == 1)
    end = int(v.min() + 0.6 * np.ptp(v))
    cut = replace(
        frame,
        labels=np.ascontiguousarray(frame.labels[:end]),
        depth=np.ascontiguousarray(frame.depth[:end]),
        colour=np.ascontiguousarray(frame.colour[:end]),
        camera=replace(CAMERA, height=end),
    )
    T = frame.T_map_camera

    def lowest(keyframe: Keyframe) -> float:
        return float((outline_of(keyframe, 1) @ T[:3, :3].T + T[:3, 3])[:, 2].min())

    assert lowest(frame) == pytest.approx(0, abs=0.01)
    assert lowest(cut) > 0.05


def test_outlines_follow_when_the_depths_scale_becomes_known() -> None:
    """Depth that is 2 % short has them nearer; once that is known they are where true depth has them."""
    frames = [torn(frame, 0.19) for frame in views()]
    short = [replace(frame, depth=frame.depth / 1.02, planes=frame.planes / (1, 1, 1, 1.02)) for frame in frames]
    votes = ViewConsensus(SETTINGS)
    votes.update(short)
    rescaled, true = votes.update([], Calibration(1.02)).objects, found(frames)
    assert len(rescaled) == len(true) == 2
    for one, other in zip(rescaled, true, strict=True):
        assert np.abs(one.box.centre - other.box.centre).max() < 0.003
        assert np.abs(one.box.size - other.box.size).max() < 0.005
