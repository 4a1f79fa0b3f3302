"""The paper's steps in plain NumPy: readable, slow, and the results that the kernels must equal."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from spot3d.camera import Intrinsics, back_project
from spot3d.depth_noise import KINECT_V1
from spot3d.fusion.objects.agreement import Statements


def weighted_heat(
    depth: NDArray[np.float32],
    camera: Intrinsics,
    boxes: NDArray[np.float32],
    depth_range_min: float = 0.5,
    size_min: float = 0.02,
    size_max: float = 1.0,
    size_depth: str = "middle",
) -> NDArray[np.float64]:
    """H_2D of Eqs. 2-6, not normalised: (h, w). depth: (h, w) metres, 0 = invalid; boxes: (M, 5)."""
    heat = np.zeros(depth.shape)
    for x, y, w, h, c in boxes:
        u0, v0, u1, v1 = (int(np.rint(value)) for value in (x, y, x + w, y + h))
        inside = np.zeros(depth.shape, bool)
        inside[max(v0, 0) : max(v1, 0), max(u0, 0) : max(u1, 0)] = True
        valid = depth[inside & (depth > 0)]
        if len(valid) == 0:
            continue
        near, far = valid.min(), valid.max()
        middle = (near + far) / 2
        background = (depth > middle) & (far - near > depth_range_min)
        z = middle if size_depth == "middle" else depth[inside & (depth > 0) & ~background].mean(dtype=np.float64)
        size = np.array([w * z / camera.fx, h * z / camera.fy])
        if (size < size_min).all() or (size > size_max).all():
            continue
        heat += c * (inside & ~background)
    return heat


def lattice_depth(depth: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Mean of each block's valid pixels within the noise of its nearest, 0 without any. depth: (h, w) metres."""
    h, w = depth.shape
    padded = np.pad(depth, ((0, -h % factor), (0, -w % factor)))
    blocks = padded.reshape(padded.shape[0] // factor, factor, -1, factor)
    nearest = np.where(blocks > 0, blocks, np.inf).min(axis=(1, 3))
    limit = np.where(np.isfinite(nearest), 1.005 * nearest + 4 * KINECT_V1.sigma(np.minimum(nearest, 1e3)), 0)
    near = (blocks > 0) & (blocks <= limit[:, None, :, None])
    count = near.sum(axis=(1, 3))
    mean = (blocks * near).sum(axis=(1, 3)) / np.maximum(count, 1)
    return np.asarray(mean, np.float32)


def triple_plane(points: NDArray[np.float32], triple: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """The plane (4,) through three of the points, b >= 0; None if they are collinear."""
    a, b, c = points[triple].astype(np.float64)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal)
    if length == 0:
        return None
    plane: NDArray[np.float64] = np.append(normal, -normal @ a) / length
    return plane if plane[3] >= 0 else -plane


def inliers(points: NDArray[np.float32], plane: NDArray[np.float64], distance: float) -> int:
    """How many points lie within `distance` metres of a plane."""
    n, b = plane[:3].astype(np.float32), np.float32(plane[3])
    return int(np.count_nonzero(np.abs(points @ n + b) < distance))


def dominant_plane(
    points: NDArray[np.float32], distance: float, triples: NDArray[np.int64]
) -> tuple[NDArray[np.float64], int]:
    """The plane of most inliers among triples of points (Eq. 9). points: (n, 3); triples: (k, 3) rows.

    Returns the plane (4,) with b >= 0 and its number of inliers.
    """
    best, most = np.zeros(4), -1
    for triple in triples:
        plane = triple_plane(points, triple)
        found = -1 if plane is None else inliers(points, plane, distance)
        if plane is not None and found > most:
            best, most = plane, found
    return best, most


def warp(
    last_index: NDArray[np.int32],
    last_depth: NDArray[np.float32],
    last_colour: NDArray[np.uint8],
    depth: NDArray[np.float32],
    colour: NDArray[np.uint8],
    T_camera_last: NDArray[np.float64],
    camera: Intrinsics,
    colour_gate: float,
    depth_gate: float,
) -> NDArray[np.int32]:
    """The index map warped into the next frame (Eqs. 12-14): (h, w) rows of the map, -1 = no match."""
    h, w = depth.shape
    index = np.full((h, w), -1, np.int32)
    nearest = np.full((h, w), np.inf)
    points = back_project(last_depth, camera).reshape(-1, 3)
    moved = points @ T_camera_last[:3, :3].T + T_camera_last[:3, 3]
    for pixel in np.flatnonzero((last_index.ravel() >= 0) & (moved[:, 2] > 0)):
        x, y, z = moved[pixel]
        u, v = int(np.rint(camera.fx * x / z + camera.cx)), int(np.rint(camera.fy * y / z + camera.cy))
        if not (0 <= u < w and 0 <= v < h) or z >= nearest[v, u]:
            continue
        difference = colour[v, u].astype(float) - last_colour.reshape(-1, 3)[pixel]
        if np.linalg.norm(difference) / 255 <= colour_gate and abs(depth[v, u] - z) <= depth_gate:
            nearest[v, u], index[v, u] = z, last_index.ravel()[pixel]
    return index


def said_by_view(
    labels: NDArray[np.uint8],
    depth: NDArray[np.uint16],
    pose: NDArray[np.float32],
    focal: NDArray[np.float32],
    places: NDArray[np.float32],
    tolerance: float = 0.03,
) -> list[tuple[str, int]]:
    """One view's statement on each segment, and the label that contains the segment (MaskClustering, Sec. 3).

    labels, depth: (h, w), millimetres; pose: (3, 4) camera from world; focal: fx, fy, cx, cy; places: (n, k, 3) world,
    of which every fourth is projected. A view sees a segment with at least 0.3 of its points at its depth; more than
    0.5 of these without a label are background. Otherwise it looks through it with at least half of the points.
    """
    h, w = labels.shape
    answers = []
    for place in places[:, ::4]:
        x, y, z = pose[:, :3] @ place.T + pose[:, 3:]
        safe = np.where(z < 0.1, 1, z)
        u, v = np.floor(focal[:2, None] * (x, y) / safe + focal[2:, None] + 0.5).astype(int)
        inside = (z >= 0.1) & (u >= 0) & (v >= 0) & (u < w) & (v < h)
        u, v, z = u[inside], v[inside], z[inside]
        metres = depth[v, u] / 1000
        seen = labels[v, u][(metres > 0) & (np.abs(metres - z) < tolerance)]
        count = np.bincount(seen, minlength=256)
        best = int(count[1:].argmax()) + 1
        if len(seen) < 0.3 * len(place):
            through = (metres > 0) & (metres - z >= tolerance)
            answers.append(("through" if through.sum() >= 0.5 * len(place) else "nothing", 0))
        elif count[0] > 0.5 * len(seen):
            answers.append(("background", 0))
        elif count[best] >= 0.75 * len(seen):
            answers.append(("whole", best))
        else:
            answers.append(("divided" if (count[1:] >= 0.2 * len(seen)).sum() > 1 else "object", 0))
    return answers


def clusters(said: Statements, views_min: int, object_share: float) -> list[set[int]]:
    """Clusters of segments that most frames observing them have in one segment (MaskClustering, Sec. 3), by sets.

    The two that agree best are joined first. A frame's vote is as the pixels that it has on both. A cluster that more
    frames have in one segment with a larger one than show it by itself is joined to it as its part. views_min: least
    frames that show an object; object_share: least share of the frames observing it that see it as an object.
    """
    frame, observed, within, divided, background, centre, eye = said
    observers: list[set[int]] = [set() for _ in frame]
    holders = [{row} for row in range(len(frame))]
    for row, by in observed.tolist():
        observers[row].add(by)
    for row, holder in within.tolist():
        holders[row].add(holder)
    seen = [1 + len(by - {own}) for by, own in zip(observers, frame.tolist(), strict=True)]
    times, unseen = Counter(divided.tolist()), Counter(background.tolist())
    several = {row for row in times if times[row] >= 0.5 * seen[row]}
    spilled = {row for row in unseen if seen[row] < object_share * (seen[row] + unseen[row])}
    for row, own in enumerate(frame.tolist()):
        wrong = holders[row] & (several if row in spilled else several | spilled)
        observers[row] = observers[row] - {int(frame[holder]) for holder in wrong} | {own}
        holders[row] -= wrong
    groups = [[row] for row in range(len(frame)) if row not in several]
    while True:
        pairs = []
        known = []
        for rows in groups:
            sees = Counter(by for row in rows for by in observers[row])
            holds = Counter(holder for row in rows for holder in holders[row])
            held = {holder for holder, count in holds.items() if 2 * count > sees[int(frame[holder])]}
            middle = np.mean(centre[rows], axis=0)
            known.append(({by: 1 / max(float(np.linalg.norm(middle - eye[by])), 0.1) for by in sees}, held))
        for j, (other_nearness, other_held) in enumerate(known):
            for i, (nearness, held) in enumerate(known[:j]):
                votes = {by: nearness[by] * other_nearness[by] for by in nearness.keys() & other_nearness.keys()}
                if in_one := held & other_held:
                    share = round(sum(votes[int(frame[row])] for row in in_one) / sum(votes.values()), 9)
                    pairs.append((i, j, len(votes), share))
        agreed = [
            (-(share * views + 1) / (views + 2), i, j) for i, j, views, share in pairs if views > 1 and share >= 0.6
        ]
        taken: set[int] = set()
        for _, i, j in sorted(agreed):
            if not {i, j} & taken:
                taken |= {i, j}
                groups[i] = groups[i] + groups[j]
                groups[j] = []
        groups = [rows for rows in groups if rows]
        if not agreed:
            break
    shown = [len({int(frame[row]) for row in rows}) for rows in groups]
    wholes: dict[int, list[tuple[float, int, int]]] = {}
    for i, j, views, share in pairs:
        part, whole = (i, j) if shown[i] <= shown[j] else (j, i)
        if views_min <= shown[part] < min(shown[whole], share * views):
            wholes.setdefault(part, []).append((share, shown[whole], -whole))
    joined: dict[int, set[int]] = {}
    for i, rows in enumerate(groups):
        while i in wholes:
            i = -max(wholes[i])[2]
        joined.setdefault(i, set()).update(rows)
    return list(joined.values())
