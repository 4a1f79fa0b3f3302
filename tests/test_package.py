"""What `from spot3d import ...` offers."""

import subprocess
import sys
from dataclasses import replace

import pytest

import spot3d


@pytest.mark.parametrize("name", spot3d.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(spot3d, name).__name__ == name


def test_the_package_alone_loads_nothing() -> None:
    code = "import sys, spot3d; print([name for name in ('numpy', 'pydantic', 'cv2', 'numba') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.strip() == "[]"


def test_what_it_does_not_have_is_named() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Fusoin'"):
        spot3d.Fusoin  # noqa: B018


def test_what_it_offers_suffices_to_find_objects() -> None:
    sequence, fusion = spot3d.open_source("scene"), spot3d.Fusion(spot3d.FusionSettings())
    for index in (0, 40, 80):
        frame = sequence[index]
        colour, depth, camera = frame.colour[::2, ::2].copy(), frame.depth_metres()[::2, ::2].copy(), frame.intrinsics
        camera = replace(camera, width=320, height=240, fx=camera.fx / 2, fy=camera.fy / 2, cx=159.5, cy=119.5)
        boxes = spot3d.propose(colour, depth, camera, spot3d.ProposalSettings())
        heat = spot3d.weighted_heat(depth, camera, boxes, spot3d.HeatmapSettings()).heat
        pose = spot3d.CameraPose(frame.T_world_camera)
        fusion.fuse(colour, depth, heat, camera, pose, frame.stamp_ns)
        segments = spot3d.find_segments(colour, depth, heat, camera, spot3d.SegmentsSettings())
        assert fusion.observe(segments, frame.stamp_ns)
    assert fusion.objects().objects
