"""Every value that the preset `paper` resolves to, so that none changes or is lost unseen (docs/method.md)."""

import os
from typing import Any

import pytest

from spot3d.settings import Settings, load_settings, without_settings

PROPOSALS = {
    "max_boxes": 1000,
    "alpha": 0.65,
    "beta": 0.75,
    "apart": 1.0,
    "cluster_min_magnitude": 0.5,
    "min_box_area": 1000.0,
    "scaled_area": False,
    "gamma": 2.0,
    "refined": 1_000_000,
    "finest": 0,
    "search_width": 100_000,
    "metric_culling": False,
    "size_min": 0.02,
    "size_max": 1.0,
    "edges": {"depth": False, "min_magnitude": 0.1, "colour_contrast": 80.0},
}
HEATMAP = {
    "depth_range_min": 0.5,
    "size_min": 0.02,
    "size_max": 1.0,
    "size_depth": "foreground",
    "soft_filter": True,
    "hard_filter": True,
}
FUSION = {
    "plane_distance": 0.005,
    "plane_triples": 10_000,
    "plane_candidates": 5,
    "plane_search": "triples",
    "plane_heat_max": 1.0,
    "keyframe_interval": 10,
    "plane_pixels": "keyframe",
    "plane_removal": True,
    "colour_gate": 0.05,
    "depth_gate": 0.01,
    "noise_gate": 0.0,
    "grazing_cos": 0.0,
    "lattice_width": 100_000,
    "noise_weighting": False,
    "look_up": True,
    "speed_max": 20.0,
    "voxel": 0.005,
    "map_limit": 2_000_000,
    "range_max": 1000.0,
    "frequency_min": 5,
    "frequency_share": 0.05,
    "tau": 10.0,
    "tau_share": 0.0,
    "heat_min": 0.25,
    "clustering": "density",
    "density_radius": 0.02,
    "density_points": 50,
    "density_cell": 0.005,
    "object_interval_s": 0.4,
    "size_min": 0.02,
    "size_max": 1.0,
    "volume_min": 1e-6,
    "seed": 0,
}
OF_CONSENSUS = {"keyframe_limit", "views_min", "views_tau", "object_share", "skipped"}
"""Settings of fusion that have no part in the paper's way."""
ELSEWHERE = {
    "preset": "paper",
    "pose": {"given_sigma": 0.0, "depth_bend_sigma": 0.0},
    "segments": {"enabled": False, "recent_frames": 0, "noise_gate": 0.0, "grazing_cos": 0.0},
}
"""What else is not as in the preset `default`."""


@pytest.fixture(autouse=True)
def no_settings_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in set(os.environ) - set(without_settings(os.environ)):
        monkeypatch.delenv(name)


def changed(given: dict[str, Any], default: dict[str, Any]) -> dict[str, Any]:
    """The values that are not the default's, in their sections."""
    found = {}
    for name, value in given.items():
        if value != default[name]:
            found[name] = changed(value, default[name]) if isinstance(value, dict) else value
    return found


def test_the_sections_of_the_papers_method() -> None:
    paper = load_settings(preset="paper")
    assert paper.proposals.model_dump() == PROPOSALS
    assert paper.heatmap.model_dump() == HEATMAP
    assert paper.fusion.model_dump(exclude=OF_CONSENSUS) == FUSION


def test_what_else_differs_from_the_default() -> None:
    whole = {name for name in Settings.model_fields if name not in {"proposals", "heatmap", "fusion"}}
    paper, default = (load_settings(preset=preset).model_dump(include=whole) for preset in ("paper", "default"))
    assert changed(paper, default) == ELSEWHERE
