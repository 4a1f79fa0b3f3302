import numpy as np
import pytest
from numba import njit
from scenes import camera, overlaps, squares

from spot3d.proposals.metric_size import depth_range, surely_rejected
from spot3d.proposals.propose import metric_limits, propose
from spot3d.proposals.settings import ProposalSettings

FX, FY, SMALLEST, BIGGEST = 260.0, 250.0, 0.02, 1.0


@njit
def rejected_unseen(ranges, window):
    """`surely_rejected` as it is compiled into the search."""
    return surely_rejected(ranges, window[0], window[1], window[2], window[3])


def hard_filter_rejects(depth, window, z):
    """Paper, Eq. 5, for the mean depth z of what the window shows."""
    x0, y0, x1, y1 = window
    w, h = (x1 - x0) * z / FX, (y1 - y0) * z / FY
    return max(w, h) < SMALLEST or min(w, h) > BIGGEST


def test_only_windows_are_culled_that_the_hard_filter_rejects_for_any_mean_depth():
    rng = np.random.default_rng(2)
    culled = 0
    for scene in range(30):
        depth = rng.uniform(0.3, 6, (6, 8)).repeat(20, 0).repeat(20, 1).astype(np.float32)
        if scene % 2:
            depth[:] = rng.uniform(0.3, 6)
        depth[rng.random(depth.shape) < 0.3] = 0
        ranges = depth_range(depth, *np.float32((FX, FY, SMALLEST, BIGGEST)))
        for _ in range(100):
            x, y = np.sort(rng.choice(161, 2, replace=False)), np.sort(rng.choice(121, 2, replace=False))
            window = (int(x[0]), int(y[0]), int(x[1]), int(y[1]))
            if rejected_unseen(ranges, window):
                culled += 1
                seen = depth[window[1] : window[3], window[0] : window[2]]
                seen = seen[seen > 0]
                for z in (seen.min(), seen.mean(), (seen.min() + seen.max()) / 2, seen.max()) if seen.size else ():
                    assert hard_filter_rejects(depth, window, z)
    assert culled > 20


@pytest.mark.parametrize(
    ("z", "window", "rejected"),
    [
        (0.0, (40, 40, 80, 80), True),  # no depth at all
        (1.0, (40, 40, 80, 80), False),
        (1.0, (40, 40, 44, 44), True),  # 15 mm
        (1.0, (40, 40, 44, 80), False),  # thin but long
        (4.0, (0, 0, 160, 120), True),  # 2.5 m by 1.9 m
        (4.0, (0, 0, 160, 40), False),  # long but not high
    ],
)
def test_flat_wall(z, window, rejected):
    ranges = depth_range(np.full((120, 160), z, np.float32), *np.float32((FX, FY, SMALLEST, BIGGEST)))
    assert rejected_unseen(ranges, window) == rejected


@pytest.mark.parametrize("reason", ["no depth", "setting"])
def test_nothing_is_culled_without_depth_or_by_setting(reason):
    depth = np.full((240, 320), 0 if reason == "no depth" else 9, np.float32)
    settings = ProposalSettings(metric_culling=reason == "no depth")
    assert not rejected_unseen(metric_limits(depth, camera(), settings), (0, 0, 320, 240))


def test_culling_takes_off_the_box_of_what_is_too_big():
    big, small = (80, 60, 150, 110), (20, 20, 30, 30)
    colour, depth = squares(big, small)
    depth *= 3  # the big one is 2 m wide
    kept, everything = (
        propose(colour, depth, camera(), ProposalSettings(metric_culling=culling)) for culling in (True, False)
    )
    assert overlaps(everything, big).max() > 0.7
    assert overlaps(kept, big).max() < 0.5
    assert overlaps(kept, small).max() > 0.5
