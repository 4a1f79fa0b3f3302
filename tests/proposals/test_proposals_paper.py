"""What `paper` and `default` propose where they differ (the table in docs/method.md)."""

import numpy as np
import pytest
from scenes import WALL, camera, overlaps, squares

from spot3d.heatmap.heat import weighted_heat
from spot3d.heatmap.settings import PAPER as PAPER_HEATMAP
from spot3d.proposals.propose import propose
from spot3d.proposals.settings import ProposalSettings
from spot3d.settings import load_settings

PAPER, DEFAULT = load_settings(preset="paper").proposals, ProposalSettings()
BOX = (60, 70, 70, 90)


def test_colour_edges_alone_are_searched() -> None:
    """A box of the wall's colour stands out in depth only."""
    colour, depth = squares(BOX)
    grey = np.full_like(colour, 128)
    assert len(propose(grey, depth, camera(), PAPER)) == 0
    assert overlaps(propose(grey, depth, camera(), DEFAULT)[:5], BOX).max() > 0.7


def test_depth_changes_no_box() -> None:
    colour, depth = squares(BOX)
    boxes = propose(colour, depth, camera(), PAPER)
    np.testing.assert_array_equal(boxes, propose(colour, np.zeros_like(depth), camera(), PAPER))
    assert overlaps(boxes[:5], BOX).max() > 0.7


def test_the_search_is_at_full_size() -> None:
    colour, depth = squares((121, 141, 141, 181), shape=(480, 640))
    paper, default = (propose(colour, depth, camera(640, 480), settings)[:, :4] for settings in (PAPER, DEFAULT))
    assert (default % 2 == 0).all()
    assert (paper % 2 == 1).any()


@pytest.mark.parametrize(("settings", "least"), [(PAPER, 1000), (DEFAULT, 250)])
def test_the_smallest_window_has_so_many_pixels_whatever_the_image(settings: ProposalSettings, least: int) -> None:
    """EdgeBoxes' minBoxArea, 1000 square pixels; the default's follows the image's size."""
    colour, depth = squares(*((x, y, 16, 16) for x in range(40, 280, 40) for y in range(40, 200, 40)))
    boxes = propose(colour, depth, camera(), settings.model_copy(update={"refined": 0}))[:, :4]
    inner = boxes[(boxes[:, :2] > 0).all(axis=1) & (boxes[:, :2] + boxes[:, 2:] < (320, 240)).all(axis=1)]
    assert (inner[:, 2] * inner[:, 3]).min() == pytest.approx(least, rel=0.1)


def found(seed: int | None = None, **changes: object) -> np.ndarray:
    """The paper's boxes of a square, in noise with a `seed`, as many as there are; changes: of the settings."""
    colour, depth = squares(BOX)
    if seed is not None:
        noise = np.random.default_rng(seed).normal(0, 25, colour.shape)
        colour = np.clip(colour + noise, 0, 255).astype(np.uint8)
    return propose(colour, depth, camera(), PAPER.model_copy(update={"max_boxes": 10_000, "beta": 1.0, **changes}))


def test_groups_of_less_than_the_least_magnitude_join_others() -> None:
    assert len(found()) > 0
    assert len(found(cluster_min_magnitude=1e6)) == 0, "nothing is left that they could join"


def test_the_higher_gamma_the_less_contours_that_turn_hang_together() -> None:
    """What crosses a window's border takes off less of what it continues."""
    scores = []
    for gamma in (1.0, 2.0, 4.0):
        boxes = found(seed=0, refined=0, gamma=gamma)
        scores.append({tuple(box[:4].tolist()): box[4] for box in boxes})
    windows = set.intersection(*map(set, scores))
    low, middle, high = (np.array([score[window] for window in windows]) for score in scores)
    assert len(windows) > 100
    assert ((low <= middle + 1e-6) & (middle <= high + 1e-6)).all()
    assert low.sum() < 0.99 * middle.sum() < 0.98 * high.sum()


def test_windows_are_refined_to_the_finest_move() -> None:
    """By three pixels; with half of a side, which no move of the search reaches, not at all."""
    grid, coarse, paper = found(refined=0), found(finest=2), found()
    np.testing.assert_array_equal(coarse, grid)
    assert overlaps(paper[:1], BOX)[0] > overlaps(grid[:1], BOX)[0]
    assert paper[0, 4] > grid[0, 4]


def test_a_score_is_divided_by_the_size_to_the_power_of_kappa() -> None:
    """A square twice as large has twice the edges: that is its score times its size to the power of 1.5."""
    edges = []
    for side in (80, 160):
        colour, depth = squares((60, 40, side, side))
        _, _, w, h, score = propose(colour, depth, camera(), PAPER)[0]
        edges.append(score * (w + h) ** 1.5)
    assert edges[1] / edges[0] == pytest.approx(2.0, rel=0.03)


def test_what_scores_less_than_the_least_score_is_no_proposal() -> None:
    scores = found(seed=0, refined=0, alpha=0.5)[:, 4]
    assert 0.01 < scores.min() < 0.011


def test_the_values_are_those_of_edge_boxes() -> None:
    assert (PAPER.alpha, PAPER.beta, PAPER.gamma, PAPER.edges.min_magnitude) == (0.65, 0.75, 2.0, 0.1)
    assert (PAPER.cluster_min_magnitude, PAPER.min_box_area, PAPER.max_boxes) == (0.5, 1000.0, 1000)


def test_windows_of_impossible_size_are_proposed_and_left_to_the_hard_filter() -> None:
    """A wall at 2 m, with a square of 1.5 m on it; default: as culled, but for what refinement adds."""
    colour = np.where(squares((40, 20, 200, 200))[0] == 160, 255, 0).astype(np.uint8)
    depth = np.full(colour.shape[:2], WALL, np.float32)
    metre = camera().fx / WALL
    paper, default = (
        propose(colour, depth, camera(), PAPER.model_copy(update={"metric_culling": on})) for on in (False, True)
    )
    assert (paper[:, 2:4] > metre).all(axis=1).any()
    assert weighted_heat(depth, camera(), paper, PAPER_HEATMAP).rejected > 0
    assert not (default[:, 2:4] > 1.1 * metre).all(axis=1).any()
    assert PAPER.metric_culling < DEFAULT.metric_culling
