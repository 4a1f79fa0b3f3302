"""Soft and hard filtering and the weighted heatmap against a plain transcription of Eqs. 3-6."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spot3d.bench.reference import weighted_heat as reference_heat
from spot3d.camera import Intrinsics
from spot3d.heatmap.heat import weighted_heat
from spot3d.heatmap.settings import PAPER, HeatmapSettings

CAMERA = Intrinsics(60.0, 60.0, 31.5, 23.5, 64, 48)


def step_depth(near: float = 1.0, far: float = 3.0) -> np.ndarray:
    """Left half near, right half far."""
    depth = np.full(CAMERA.shape, far, np.float32)
    depth[:, :32] = near
    return depth


def box(x: float, y: float, w: float, h: float, c: float = 1.0) -> list[float]:
    return [x, y, w, h, c]


@pytest.mark.parametrize(
    ("name", "boxes", "counts"),
    [
        ("no proposals", [], (0, 0, 0)),
        ("accepted whole: one surface", [box(4, 4, 16, 16)], (1, 0, 0)),
        ("background masked: both surfaces", [box(24, 4, 16, 16)], (0, 1, 0)),
        ("too small both ways: 1 px at 1 m is 1.7 cm", [box(4, 4, 1, 1)], (0, 0, 1)),
        ("a thin stick is kept", [box(4, 4, 1, 20)], (1, 0, 0)),
        ("too large both ways: 32 px at 3 m is 1.6 m", [box(32, 8, 32, 32)], (0, 0, 1)),
        ("large one way only is kept", [box(32, 8, 32, 10)], (1, 0, 0)),
        ("no confidence", [box(4, 4, 16, 16, 0.0)], (0, 0, 1)),
        ("less than none", [box(4, 4, 16, 16, -1.0)], (0, 0, 1)),
    ],
)
def test_filters_count_what_they_do(name: str, boxes: list[list[float]], counts: tuple[int, int, int]) -> None:
    found = weighted_heat(step_depth(), CAMERA, np.array(boxes, np.float32).reshape(-1, 5), HeatmapSettings())
    assert (found.accepted, found.masked, found.rejected) == counts, name
    assert (found.heat.max() == 255) == (counts[0] + counts[1] > 0)


@pytest.mark.parametrize(("fy", "rejected"), [(60.0, 1), (20.0, 0)])
def test_width_and_height_each_go_by_their_own_focal_length(fy: float, rejected: int) -> None:
    """A pixel at 1 m is 1.7 cm across; and as high, or 5 cm."""
    camera = Intrinsics(60.0, fy, 31.5, 23.5, 64, 48)
    found = weighted_heat(step_depth(), camera, np.array([box(4, 4, 1, 1)], np.float32), HeatmapSettings())
    assert found.rejected == rejected


@pytest.mark.parametrize(
    ("name", "given", "rejected"),
    [
        ("as the paper has it, 32 px at 1 m, 0.53 m", PAPER, 0),
        ("at the middle, 2 m, 1.07 m", HeatmapSettings(), 1),
        ("with the background, 2 m", PAPER.model_copy(update={"soft_filter": False}), 1),
    ],
)
def test_a_size_is_judged_at_the_mean_depth_of_the_foreground(name: str, given: HeatmapSettings, rejected: int) -> None:
    depth = step_depth()
    depth[20:30, 20:30] = 0
    assert weighted_heat(depth, CAMERA, np.array([box(16, 8, 32, 32)], np.float32), given).rejected == rejected, name


def test_what_lies_in_the_middle_of_a_proposals_depths_is_kept() -> None:
    depth = step_depth(1.0, 2.0)
    depth[10, 33] = 1.5
    found = weighted_heat(depth, CAMERA, np.array([box(24, 4, 16, 16)], np.float32), HeatmapSettings())
    assert found.heat[10, 33] == 255


def test_a_masked_proposal_heats_its_foreground_only() -> None:
    found = weighted_heat(step_depth(), CAMERA, np.array([box(24, 4, 16, 16)], np.float32), HeatmapSettings())
    assert (found.heat[4:20, 24:32] == 255).all()
    assert found.heat.sum() == 255 * 16 * 8


def test_without_depth_a_proposal_is_rejected() -> None:
    found = weighted_heat(
        np.zeros(CAMERA.shape, np.float32), CAMERA, np.array([box(4, 4, 9, 9)], np.float32), HeatmapSettings()
    )
    assert found.rejected == 1
    assert not found.heat.any()


def test_switched_off_filters_keep_what_they_would_take() -> None:
    boxes = np.array([box(24, 4, 16, 16), box(32, 8, 32, 32)], np.float32)
    open_settings = HeatmapSettings(soft_filter=False, hard_filter=False)
    found = weighted_heat(step_depth(), CAMERA, boxes, open_settings)
    assert (found.accepted, found.masked, found.rejected) == (2, 0, 0)


@pytest.mark.parametrize("chosen", [HeatmapSettings(), PAPER])
@settings(max_examples=60)
@given(seed=st.integers(0, 2**31), holes=st.floats(0, 0.5))
def test_equals_the_plain_transcription(chosen: HeatmapSettings, seed: int, holes: float) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.choice([0.8, 1.0, 2.5], size=(6, 8)).repeat(8, 0).repeat(8, 1).astype(np.float32)
    depth += rng.uniform(0, 0.1, depth.shape).astype(np.float32)
    depth[rng.random(depth.shape) < holes] = 0
    xy = rng.integers(-4, 60, (40, 2))
    boxes = np.column_stack((xy, rng.integers(1, 50, (40, 2)), rng.random(40))).astype(np.float32)
    expected = reference_heat(depth, CAMERA, boxes, size_depth=chosen.size_depth)
    found = weighted_heat(depth, CAMERA, boxes, chosen)
    peak = expected.max()
    assert np.abs(found.heat - 255 * expected / peak if peak > 0 else found.heat).max() <= 0.51


@pytest.mark.parametrize(
    ("depth", "boxes", "message"),
    [
        (np.ones((4, 4), np.float32), [box(0, 0, 1, 1)], "intrinsics"),
        (np.full((48, 64), 1000, np.uint16), [box(0, 0, 1, 1)], r"depth is uint16 \(48, 64\); expected float32"),
        (np.ones((48, 64), np.float32), [box(np.nan, 0, 1, 1)], "not finite"),
    ],
)
def test_wrong_input_is_refused(depth: np.ndarray, boxes: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        weighted_heat(depth, CAMERA, np.array(boxes, np.float32), HeatmapSettings())
