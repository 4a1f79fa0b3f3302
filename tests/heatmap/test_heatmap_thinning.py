"""What a thin link leaves of a frame: errors stay below what the sensor knows, and the lattice is fusion's."""

import numpy as np
import pytest

from spot3d.camera import Intrinsics
from spot3d.dataflow.settings import LinkSettings
from spot3d.depth_noise import KINECT_V1, PRESETS, DepthNoise
from spot3d.frame import RgbdFrame
from spot3d.geometry.downsampling import to_lattice
from spot3d.heatmap.thinning import rounded_depth, rounded_heat, thinned

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("share", [0.25, 0.5, 1.0])
@pytest.mark.parametrize(("scale", "noise"), [(0.001, KINECT_V1), (0.0002, KINECT_V1), (0.001, PRESETS["d435"])])
def test_depth_moves_by_half_a_share_of_its_noise_at_most(scale: float, share: float, noise: DepthNoise) -> None:
    units = np.arange(2**16, dtype=np.uint16)[None]
    rounded = rounded_depth(units, scale, share, noise)
    metres = units * scale
    assert rounded[0, 0] == 0
    assert rounded[0, 1:].min() > 0
    near = metres < 10
    # The noise grows over a step; half a unit is the message's own rounding.
    bound = 0.5 * share * noise.sigma(metres) * 1.1 + scale / 2
    assert (np.abs(rounded * scale - metres) <= bound)[near].all()
    assert len(np.unique(rounded[near])) < len(np.unique(units[near])) / 2
    assert (rounded == units)[metres >= 32].all(), "what is farther stays as it is"


def test_depth_in_metres_is_rounded_alike() -> None:
    metres = RNG.uniform(0.3, 5, (40, 50)).astype(np.float32)
    metres[:3] = 0
    rounded = rounded_depth(metres, 1.0, 0.5, KINECT_V1)
    assert rounded.dtype == np.float32
    assert (rounded[:3] == 0).all()
    error = (rounded - metres)[3:]
    assert np.abs(error / KINECT_V1.sigma(metres[3:])).max() < 0.26
    assert abs(error.mean()) < 0.05 * error.std()


@pytest.mark.parametrize(("levels", "most"), [(256, 0), (16, 8), (2, 127)])
def test_heat_keeps_its_ends_and_moves_by_half_a_level(levels: int, most: int) -> None:
    heat = np.arange(256, dtype=np.uint8)[None]
    rounded = rounded_heat(heat, levels)
    assert (rounded[0, 0], rounded[0, 255], len(np.unique(rounded))) == (0, 255, levels)
    assert np.abs(rounded.astype(int) - heat).max() == most


def test_a_larger_frame_is_sent_as_fusion_reduces_it() -> None:
    camera = Intrinsics(500.0, 500.0, 319.5, 239.5, 640, 480)
    colour = RNG.integers(0, 255, (480, 640, 3), np.uint8)
    heat = RNG.integers(0, 255, (480, 640)).astype(np.uint8)
    y, x = np.mgrid[:480, :640]
    depth = (1200 - y + x // 4 + RNG.integers(-3, 4, (480, 640))).astype(np.uint16)
    depth[200:300, 300:400] -= 150
    depth[100:150, 500:520] = 0
    frame = RgbdFrame(0, colour, depth, 0.001, camera)
    sent, sent_heat = thinned(frame, heat, LinkSettings(thin_depth_share=0, thin_heat_levels=256))
    fused = to_lattice(colour, frame.depth_metres(), heat, camera, 320)
    again = to_lattice(sent.colour, sent.depth_metres(), sent_heat, sent.intrinsics, 320)
    for name in ("colour", "depth", "heat"):
        assert np.array_equal(getattr(again, name), getattr(fused, name)), name
    assert again.camera == fused.camera


def test_depth_in_a_sensors_own_coarse_steps_stays_as_it_is() -> None:
    camera = Intrinsics(250.0, 250.0, 79.5, 59.5, 160, 120)
    disparity = RNG.integers(150, 700, camera.shape)
    coarse, fine = np.rint(575_000 / disparity).astype(np.uint16), RNG.integers(800, 3800, camera.shape)
    for depth, changes in ((coarse, False), (fine.astype(np.uint16), True)):
        frame = RgbdFrame(0, np.zeros((120, 160, 3), np.uint8), depth, 0.001, camera)
        sent, _ = thinned(frame, np.zeros(camera.shape, np.uint8), LinkSettings())
        assert np.array_equal(sent.depth, depth) != changes
