import numpy as np
import pytest
from numba import njit
from reference_edge_boxes import reference_score

from spot3d.proposals.affinity import MIN_AFFINITY, affinities
from spot3d.proposals.groups import EdgeGroups, group_edges
from spot3d.proposals.scoring import score_limit, score_window
from spot3d.proposals.window_index import index_windows

KAPPA = 1.5


@njit
def score_of(index, window, least):
    """`score_window` as it is compiled into the search."""
    return score_window(index, window[0], window[1], window[2], window[3], least)


@njit
def limit_of(index, window):
    """`score_limit` as it is compiled into the search."""
    return score_limit(index, window[0], window[1], window[2], window[3])


def noise_edges(seed, density, shape=(60, 80)):
    rng = np.random.default_rng(seed)
    magnitude = rng.uniform(0.1, 1, shape).astype(np.float32)
    magnitude[rng.random(shape) > density] = 0
    return magnitude, rng.uniform(0, np.pi, shape).astype(np.float32)


def outline_edges(shape=(60, 80)):
    magnitude, orientation = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for x0, y0, x1, y1 in ((10, 10, 40, 40), (30, 20, 70, 50)):
        for rows, columns, normal in (
            ([y0, y1], slice(x0, x1 + 1), np.pi / 2),
            (slice(y0 + 1, y1), [x0, x1], 0.0),
        ):
            magnitude[rows, columns], orientation[rows, columns] = 1, normal
    return magnitude, orientation


def grouped(magnitude, orientation, smallest=0.5) -> EdgeGroups:
    return group_edges(magnitude, orientation, smallest, 2.0)


@pytest.mark.parametrize(
    ("magnitude", "orientation"),
    [
        noise_edges(0, 0.0),
        noise_edges(1, 0.02),
        noise_edges(2, 0.1),
        noise_edges(3, 0.4),
        outline_edges(),
    ],
)
def test_kernel_equals_reference_and_stays_below_its_limit(magnitude, orientation):
    groups = grouped(magnitude, orientation)
    index = index_windows(magnitude, groups, KAPPA)
    rng = np.random.default_rng(7)
    windows = [(10, 10, 41, 41), (9, 9, 42, 42), (0, 0, 80, 60), (29, 19, 72, 52)]
    for _ in range(150):
        x, y = np.sort(rng.choice(81, 2, replace=False)), np.sort(rng.choice(61, 2, replace=False))
        windows.append((int(x[0]), int(y[0]), int(x[1]), int(y[1])))
    for window in windows:
        expected = reference_score(magnitude, groups, window, KAPPA)
        got = score_of(index, window, np.float32(0))
        assert got == pytest.approx(expected, rel=1e-3, abs=2e-4), window
        assert got <= limit_of(index, window) + 1e-4 or got == 0
        # A score that is asked to exceed itself is given up; one that does not need to is complete.
        assert score_of(index, window, np.float32(expected + 1e-3)) == 0
        if expected > 0.01:
            assert score_of(index, window, np.float32(expected - 5e-3)) == got


def test_a_window_around_an_outline_beats_one_that_cuts_it():
    magnitude, orientation = outline_edges()
    index = index_windows(magnitude, grouped(magnitude, orientation), KAPPA)
    whole = score_of(index, (29, 19, 72, 52), np.float32(0))
    cut = score_of(index, (29, 19, 60, 52), np.float32(0))
    assert whole > 2 * cut


@pytest.mark.parametrize("density", [0.0, 0.05, 0.5])
def test_every_group_is_connected_and_accounted_for(density):
    magnitude, orientation = noise_edges(5, density)
    groups = grouped(magnitude, orientation)
    labels = groups.label
    assert (labels[magnitude == 0] == -1).all()
    for g in range(groups.magnitude.size):
        ys, xs = np.nonzero(labels == g)
        assert groups.magnitude[g] == pytest.approx(magnitude[ys, xs].sum(), rel=1e-4)
        assert groups.magnitude[g] > 0.5
        assert labels[groups.anchor[g, 1], groups.anchor[g, 0]] == g
        row = groups.affinity[groups.first[g] : groups.first[g + 1]]
        assert (np.diff(row) <= 0).all()
        assert (row >= MIN_AFFINITY).all()


@pytest.mark.parametrize(("turned", "affinity"), [(0.0, 1.0), (np.pi / 4, 0.5), (np.pi / 2, 0.0)])
def test_affinity_of_two_pieces_on_a_line(turned, affinity):
    magnitude, orientation = np.zeros((20, 40), np.float32), np.zeros((20, 40), np.float32)
    magnitude[10, 5:15] = magnitude[10, 16:26] = 1
    orientation[10, 5:15], orientation[10, 16:26] = np.pi / 2, (np.pi / 2 + turned) % np.pi
    groups = grouped(magnitude, orientation)
    assert groups.magnitude.size == 2
    assert groups.affinity[:1].sum() == pytest.approx(affinity, abs=1e-5)


def test_affinities_are_the_same_where_their_number_was_thought_less(monkeypatch):
    magnitude, orientation = noise_edges(3, 0.4)
    enough = grouped(magnitude, orientation)
    monkeypatch.setattr("spot3d.proposals.affinity.PAIRS", 0)
    found = grouped(magnitude, orientation)
    assert found.affinity.size > 0
    for ours, theirs in zip(found, enough, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_groups_around_the_same_place_have_no_affinity():
    label = np.full((8, 8), -1, np.int32)
    label[3, 2:5], label[4, 2:5] = 0, 1
    edges = np.flatnonzero(label >= 0)
    mean, normal = np.full((2, 2), 3, np.float32), np.tile(np.array([0, 1], np.float32), (2, 1))
    first, neighbour, affinity = affinities(label, edges, mean, normal, 2)
    assert first.tolist() == [0, 0, 0]
    assert neighbour.size == affinity.size == 0
