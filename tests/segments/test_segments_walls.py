"""A surface behind which nothing is seen is a piece of a wall, and a board that stands free is none."""

import numpy as np
import pytest
from fusion_room import ROOM, Cuboid, look_at, standing, view

from spot3d.camera import Intrinsics, back_project, invert
from spot3d.geometry.downsampling import to_lattice
from spot3d.geometry.normals import surface_normals
from spot3d.segments.finder import find_segments
from spot3d.segments.settings import SegmentsSettings
from spot3d.segments.walls import is_wall

CAMERA = Intrinsics(300.0, 300.0, 159.5, 119.5, 320, 240)
POSE = look_at((0.1, -1.0, 0.35), (0, 0.3, 0.15))
UP = invert(POSE)[:3, :3] @ (0, 0, 1.0)
SETTINGS = SegmentsSettings()
PANEL = (10, 200, 90)
BACK = Cuboid((0, 0.36, 0.2), (0.8, 0.02, 0.4), colour=PANEL, heat=1.0)
SIDES = tuple(Cuboid((x, 0.2, 0.2), (0.02, 0.34, 0.4)) for x in (-0.41, 0.41))
ROOF = Cuboid((0, 0.2, 0.41), (0.84, 0.34, 0.02))
NICHE = (BACK, *SIDES, ROOF)
CARTON = standing(-0.1, 0.1, (0.12, 0.1, 0.16))


def of_colour(things: tuple[Cuboid, ...], noise: bool = False, pose: np.ndarray = POSE) -> bool:
    """Whether what has the panel's colour is taken for a wall."""
    seen = view(pose, (*ROOM, *things), np.random.default_rng(0) if noise else None, CAMERA)
    frame = to_lattice(seen.colour, seen.depth, seen.heat, CAMERA, 320, 0.0)
    pixels = np.flatnonzero((seen.colour == PANEL).all(axis=-1) & (seen.depth > 0))
    assert len(pixels) > 200
    up = invert(pose)[:3, :3] @ (0, 0, 1.0)
    normals = surface_normals(frame.depth, frame.camera)
    return is_wall(pixels, frame, back_project(frame.depth, frame.camera), normals, up, SETTINGS)


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("before", [(), (CARTON,)])
def test_the_back_of_a_niche_is_a_wall(before: tuple[Cuboid, ...], noise: bool) -> None:
    assert of_colour((*NICHE, *before), noise)


@pytest.mark.parametrize(
    ("name", "things", "pose"),
    [
        ("a board that stands free", (BACK,), POSE),
        ("one with sides, above which it is open", (BACK, *SIDES), POSE),
        ("a carton", (standing(0, 0.2, (0.3, 0.2, 0.2), colour=PANEL),), POSE),
        ("a tray that lies", (standing(0, 0.1, (0.4, 0.3, 0.02), colour=PANEL), *SIDES, ROOF), POSE),
        ("one of which the image shows a part alone", NICHE, look_at((0.1, -0.05, 0.2), (0.1, 0.3, 0.2))),
    ],
)
def test_what_is_no_wall(name: str, things: tuple[Cuboid, ...], pose: np.ndarray) -> None:
    assert not of_colour(things, pose=pose), name


def test_a_wall_in_a_frame_holds_no_heat() -> None:
    seen = view(POSE, (*ROOM, *NICHE, CARTON), None, CAMERA)
    warm = np.full(seen.heat.shape, 100, np.uint8)
    wall, carton = ((seen.colour == colour).all(axis=-1) for colour in (PANEL, CARTON.colour))
    found = find_segments(seen.colour, seen.depth, warm, CAMERA, SETTINGS)
    of_wall = np.unique(found.labels[wall])
    assert np.mean(found.labels[wall] > 0) > 0.9, "it has a vote"
    assert (found.heat[of_wall[of_wall > 0] - 1] == 0).all()
    assert found.heat[np.bincount(found.labels[carton]).argmax() - 1] == pytest.approx(100 / 255)
    all_warm = find_segments(seen.colour, seen.depth, warm, CAMERA, SETTINGS.model_copy(update={"skipped": ("walls",)}))
    assert all_warm.heat == pytest.approx(100 / 255)
