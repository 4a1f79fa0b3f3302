import numpy as np
import pytest
from scenes import WALL, camera, squares

from spot3d.depth_noise import KINECT_V1
from spot3d.proposals.edges import detect_edges, thin
from spot3d.proposals.settings import EdgeSettings

BOX = (100, 80, 80, 60)
GREY = np.full((240, 320, 3), 128, np.uint8)


def depth_edges(depth):
    return detect_edges(GREY, depth, camera().fx, EdgeSettings())


def test_a_jump_is_one_thin_closed_line_with_its_normal():
    _, depth = squares(BOX)
    edges = depth_edges(depth)
    x, y, w, h = BOX
    crossing = edges.magnitude[y + h // 2] > 0
    assert crossing.sum() == 2
    np.testing.assert_allclose(np.nonzero(crossing)[0], [x, x + w - 1], atol=1)
    assert np.abs(np.sin(edges.orientation[y + h // 2, crossing])).max() < 0.1
    assert edges.magnitude.max() <= 1
    assert edges.orientation.min() >= 0
    assert edges.orientation.max() < np.pi


def slanted_plane(tilt):
    v = (np.arange(240, dtype=np.float32)[:, None] - camera().cy) / camera().fy
    return (1.5 / (1 + tilt * v) + np.zeros((1, 320), np.float32)).astype(np.float32)


@pytest.mark.parametrize("tilt", [0.0, 1.0, 1.5])
def test_planes_have_no_edges_however_grazing(tilt):
    assert not depth_edges(slanted_plane(tilt)).magnitude[6:-6, 6:-6].any()


def test_noise_of_a_kinect_is_no_edge():
    rng = np.random.default_rng(0)
    for z in (0.8, 1.5, 3.0):
        depth = z + rng.normal(0, KINECT_V1.sigma(z), (240, 320)).astype(np.float32)
        assert (depth_edges(depth.astype(np.float32)).magnitude > 0).mean() < 0.002


def test_a_concave_bend_is_an_edge_and_a_convex_one_a_weaker():
    bend = np.maximum(slanted_plane(1.0), 0)
    concave = np.minimum(slanted_plane(1.0), slanted_plane(-1.0))
    convex = np.maximum(slanted_plane(1.0), slanted_plane(-1.0))
    strongest = [depth_edges(z).magnitude[100:140, 100:200].max() for z in (bend, concave, convex)]
    assert strongest[0] == 0
    assert strongest[2] != strongest[1]
    assert max(strongest) > 0.3


def test_the_shadow_beside_an_object_does_not_widen_it():
    colour, depth = squares(BOX)
    x, y, w, h = BOX
    depth[y : y + h, x - 12 : x] = 0
    edges = np.nonzero(detect_edges(colour, depth, camera().fx, EdgeSettings()).magnitude[y + h // 2])[0]
    np.testing.assert_allclose(edges, [x, x + w - 1], atol=1)


def test_holes_in_a_wall_have_no_edges():
    rng = np.random.default_rng(1)
    depth = np.full((240, 320), WALL, np.float32)
    depth[rng.random(depth.shape) < 0.3] = 0
    depth[50:90, 200:260] = 0
    assert not depth_edges(depth).magnitude.any()


def test_colour_counts_less_beside_depth():
    colour, depth = squares(BOX)
    colour[colour > 128] = 220
    flat = np.full_like(depth, WALL)
    alone = detect_edges(colour, np.zeros_like(depth), camera().fx, EdgeSettings()).magnitude.max()
    beside = detect_edges(colour, flat, camera().fx, EdgeSettings()).magnitude.max()
    assert alone == pytest.approx(2 * beside)
    assert beside > 0


def plain_thin(strength, smooth):
    """Maxima of strength across the ridges of `smooth`, pixel by pixel: the normal by eigenvectors."""
    magnitude, orientation = np.zeros_like(strength), np.zeros_like(strength)
    for y, x in np.ndindex(*np.subtract(strength.shape, 2)):
        s, b = strength[y : y + 3, x : x + 3], smooth[y : y + 3, x : x + 3]
        xx, yy = b[1, 2] + b[1, 0] - 2 * b[1, 1], b[2, 1] + b[0, 1] - 2 * b[1, 1]
        xy = (b[2, 2] + b[0, 0] - b[2, 0] - b[0, 2]) / 4
        nx, ny = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))[1][:, 0]
        u, v = (1, ny / nx) if abs(nx) >= abs(ny) else (nx / ny, 1)

        def beside(du, dv, s=s):
            (c, p), (r, q) = divmod(1 + du, 1), divmod(1 + dv, 1)
            c, r = int(c), int(r)
            rows, columns = s[r : r + 2], slice(c, c + 2)
            return float(np.array([1 - q, q])[: len(rows)] @ rows[:, columns] @ np.array([1 - p, p])[: 3 - c])

        if s[1, 1] > beside(u, v) and s[1, 1] >= beside(-u, -v):
            magnitude[y + 1, x + 1] = s[1, 1]
            orientation[y + 1, x + 1] = np.arctan2(ny, nx) % np.pi
    return magnitude, orientation


@pytest.mark.parametrize("seed", [0, 1])
def test_thinning_equals_the_plain_transcription(seed):
    rng = np.random.default_rng(seed)
    strength = rng.random((30, 41)).astype(np.float32)
    strength[rng.random(strength.shape) < 0.3] = 0
    smooth = rng.random(strength.shape).astype(np.float32)
    magnitude, orientation = np.zeros((2, *strength.shape), np.float32)
    thin(strength, smooth, magnitude, orientation)
    expected = plain_thin(strength.astype(np.float64), smooth.astype(np.float64))
    np.testing.assert_array_equal(magnitude > 0, expected[0] > 0)
    np.testing.assert_allclose(magnitude, expected[0])
    turned = np.abs(orientation - expected[1])[magnitude > 0]
    assert np.minimum(turned, np.pi - turned).max() < 1e-3
