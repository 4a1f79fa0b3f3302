"""Which segments become one, by who sees and holds them."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.sparse import csr_array

from spot3d.fusion.objects import agreement
from spot3d.fusion.objects.agreement import Statements, clusters_of

Pairs = list[tuple[int, int]]


def clusters(
    frame: list[int],
    observed: Pairs,
    within: Pairs,
    divided: list[int] | None = None,
    background: list[int] | None = None,
    views_min: int = 3,
    join_parts: bool = True,
    ranges: dict[int, float] | None = None,
) -> list[int]:
    """Numbers of the clusters, in the order of their first segments. ranges: of frames, 1 if not stated."""

    def pairs(listed: Pairs) -> np.ndarray:
        return np.array(listed, np.int64).reshape(-1, 2)

    def rows(listed: list[int] | None) -> np.ndarray:
        return np.array([] if listed is None else listed, np.int64)

    eyes = np.ones((1 + max((*frame, *(by for _, by in observed)), default=-1), 1)) * (0.0, 0.0, 1.0)
    for number, metres in (ranges or {}).items():
        eyes[number, 2] = metres
    said = Statements(
        rows(frame), pairs(observed), pairs(within), rows(divided), rows(background), np.zeros((len(frame), 3)), eyes
    )
    found = clusters_of(said, views_min, object_share=0.3, join_parts=join_parts)
    numbers: dict[int, int] = {-1: -1}
    return [numbers.setdefault(number, len(numbers) - 1) for number in found.tolist()]


def seen_by_all(frame: list[int]) -> Pairs:
    return [(row, other) for row, own in enumerate(frame) for other in sorted(set(frame)) if other != own]


def held_by(groups: list[list[int]]) -> Pairs:
    return [(a, b) for group in groups for a in group for b in group if a != b]


def test_of_none_there_is_none() -> None:
    assert clusters([], [], []) == []


@pytest.mark.parametrize("count", [2, 3, 10, 40])
def test_two_objects_that_all_frames_tell_apart(count: int) -> None:
    frame = [k // 2 for k in range(2 * count)]
    rows = list(range(2 * count))
    assert clusters(frame, seen_by_all(frame), held_by([rows[::2], rows[1::2]])) == [0, 1] * count


def test_what_nobody_else_sees_stays_alone() -> None:
    assert clusters([0, 1, 2], [], []) == [0, 1, 2]


def test_a_frame_may_see_objects_and_have_no_segment_of_its_own() -> None:
    """As one whose segments are all too small to be asked about."""
    assert clusters([0, 1], [(0, 1), (1, 0), (0, 3), (1, 3)], [(0, 1), (1, 0)]) == [0, 0]
    assert clusters([0, 1], [(0, 1), (1, 0), (0, 7), (1, 7)], []) == [0, 1]


def test_a_view_that_holds_several_objects_joins_none_of_them() -> None:
    """Rows 0, 2, 4 and 1, 3, 5 are objects; row 6, of frame 3, is both, and three frames divide it."""
    frame = [0, 0, 1, 1, 2, 2, 3]
    within = held_by([[0, 2, 4], [1, 3, 5]]) + [(row, 6) for row in range(6)]
    assert clusters(frame, seen_by_all(frame), within, divided=[6, 6, 6]) == [0, 1, 0, 1, 0, 1, -1]


def test_a_view_that_is_wrong_does_not_outvote_the_others() -> None:
    """Nobody divides row 6, but of four views of both objects one alone has them in one."""
    frame = [0, 0, 1, 1, 2, 2, 3]
    within = held_by([[0, 2, 4], [1, 3, 5]]) + [(row, 6) for row in range(6)]
    found = clusters(frame, seen_by_all(frame), within)
    assert found[:6] == [0, 1, 0, 1, 0, 1]


@pytest.mark.parametrize("background", [0, 4, 6, 20])
def test_what_few_see_as_an_object_joins_nothing_but_its_like(background: int) -> None:
    """Two objects in three frames each, which no frame shows together but for two more, whose rows 3 and 4 hold both
    and the floor between them. So many views say of these that there is no object."""
    frame, first, second, both = [0, 1, 2, 3, 4, 5, 6, 7], [0, 1, 2], [5, 6, 7], [3, 4]
    observed = [(row, by) for group in (first, second) for row in group for by in (*group, *both) if row != by]
    within = held_by([first, second, both]) + [(row, holder) for row in (*first, *second) for holder in both]
    found = clusters(frame, [*observed, (3, 4), (4, 3)], within, background=both * background)
    assert found == ([0] * 8 if background < 5 else [0, 0, 0, 1, 1, 2, 2, 2])


def test_two_objects_are_not_joined_by_a_chain_of_segments_between_them() -> None:
    """Frames 0 to 5 tell two objects apart. Frame 6 shows a piece between them, which frame 7 has in one with the first
    object, and frame 8 with the second: it agrees with both, which no frame has in one."""
    frame = [k // 2 for k in range(12)] + [6, 7, 8]
    first, second, piece, with_first, with_second = list(range(0, 12, 2)), list(range(1, 12, 2)), 12, 13, 14
    within = held_by([[*first, with_first], [*second, with_second], [piece, with_first]])
    within += held_by([[piece, with_second]])
    observed = [(row, by) for row in (*first, *second) for by in range(6) if by != frame[row]]
    observed += [(row, 7) for row in (*first, piece)] + [(row, 8) for row in (*second, piece)]
    observed += [(row, by) for row in (with_first, with_second) for by in range(7)]
    assert clusters(frame, observed, within) == [0, 1] * 6 + [0, 0, 1]


def test_pieces_that_some_views_have_elsewhere_do_not_join_what_they_lie_in() -> None:
    """Ten frames tell two objects apart. Two pieces, which frames 10 and 11 show alone, lie in the first object by six
    of the ten frames each, and in the second by the others, of which none is the same."""
    frame = [*range(10), *range(10), 10, 11]
    first, second = list(range(10)), list(range(10, 20))
    within = held_by([first, second])
    within += [(20, first[k] if k < 6 else second[k]) for k in range(10)]
    within += [(21, first[k] if k > 3 else second[k]) for k in range(10)]
    observed = [(row, by) for row in range(22) for by in range(10) if by != frame[row]]
    assert clusters(frame, observed, within) == [0] * 10 + [1] * 10 + [0, 0]


@pytest.mark.parametrize(("near", "apart"), [((), False), (range(4), True), (range(4, 11), False)])
def test_the_vote_of_a_view_is_as_its_pixels(near: Sequence[int], apart: bool) -> None:
    """Four views tell two objects apart, seven have them in one. Views from half the range have four times the vote."""
    frame = [k // 2 for k in range(8)] + list(range(4, 11))
    first, second, both = list(range(0, 8, 2)), list(range(1, 8, 2)), list(range(8, 15))
    within = held_by([first, second, both]) + [(row, holder) for row in (*first, *second) for holder in both]
    ranges = {number: 0.5 if number in near else 1.0 for number in range(11)}
    found = clusters(frame, seen_by_all(frame), within, ranges=ranges, join_parts=False)
    assert (found[0] != found[1]) == apart


def test_parts_that_most_views_have_in_one_join() -> None:
    """Frames 0 and 1 tore it in two; frames 2 to 9 have it whole."""
    frame = [0, 0, 1, 1, *range(2, 10)]
    parts = [(row, whole) for row in range(4) for whole in range(4, 12)]
    within = parts + held_by([[0, 2], [1, 3], list(range(4, 12))])
    observed = seen_by_all(frame)
    assert len(set(clusters(frame, observed, within))) == 1


@pytest.mark.parametrize("torn", [0, 1, 5, 8])
def test_what_a_few_of_many_views_tear_in_two_is_whole(torn: int) -> None:
    """Of 20 views so many tear it; they divide what the others have, which hold each other and all the parts."""
    frame = [k // 2 for k in range(2 * torn)] + list(range(torn, 20))
    parts, wholes = list(range(2 * torn)), list(range(2 * torn, len(frame)))
    within = held_by([parts[::2], parts[1::2], wholes]) + [(part, whole) for part in parts for whole in wholes]
    observed = seen_by_all(frame)
    assert len(set(clusters(frame, observed, within, divided=wholes * torn))) == 1


@pytest.mark.parametrize(
    ("apart", "one", "views_min"),
    [(9, 11, 3), (11, 9, 3), (9, 11, 10)],
    ids=["most have it in one", "most tell it apart", "too few show it"],
)
def test_what_most_views_have_in_one_with_another_is_a_part_of_it(apart: int, one: int, views_min: int) -> None:
    """So many views tell a small thing from a large one, the others hold both in one, and the large one is divided."""
    frame = [k // 2 for k in range(2 * apart)] + list(range(apart, apart + one))
    small, large, both = range(0, 2 * apart, 2), range(1, 2 * apart, 2), range(2 * apart, 2 * apart + one)
    within = held_by([[*small], [*large, *both]]) + [(row, holder) for row in small for holder in both]
    found = clusters(frame, seen_by_all(frame), within, views_min=views_min)
    assert len({found[row] for row in (*large, *both)}) == 1
    assert (found[0] == found[1]) == (one > apart >= views_min)
    apart_still = clusters(frame, seen_by_all(frame), within, views_min=views_min, join_parts=False)
    assert apart_still[0] != apart_still[1]


@pytest.mark.parametrize(("shown", "joined"), [((4, 5), True), ((5, 4), True), ((4, 4), False), ((6, 7), False)])
def test_a_whole_is_shown_by_more_frames_than_its_part(shown: tuple[int, int], joined: bool) -> None:
    """Five of six frames that see both have them in one; where six show the lesser by itself that is more."""
    pairs = agreement._Pairs(np.array([0]), np.array([1]), np.array([6]), np.array([5 / 6]))
    whole = agreement._whole_of(pairs, np.array(shown), views_min=3)
    assert (whole[0] == whole[1]) == joined


def test_the_order_of_what_is_said_does_not_matter() -> None:
    frame = [k // 3 for k in range(30)]
    observed = seen_by_all(frame)
    within = held_by([list(range(start, 30, 3)) for start in range(3)])
    rng = np.random.default_rng(0)
    shuffled = [[pairs[k] for k in rng.permutation(len(pairs))] for pairs in (observed, within)]
    assert clusters(frame, *shuffled) == clusters(frame, observed, within)


def test_what_does_not_hang_together_may_be_clustered_apart() -> None:
    """The reason why an update may look again at a part of all."""
    frame = [k // 4 for k in range(24)]
    groups = [list(range(start, 24, 4)) for start in range(4)]
    whole = clusters(frame, seen_by_all(frame), held_by(groups))
    left = [row for row in range(24) if row % 4 < 2]
    new = {row: k for k, row in enumerate(left)}
    observed = [(new[row], other) for row, other in seen_by_all(frame) if row in new]
    within = [(new[a], new[b]) for a, b in held_by(groups[:2])]
    assert clusters([frame[row] for row in left], observed, within) == [whole[row] for row in left]


@pytest.mark.parametrize(("rows", "frames"), [(0, 0), (1, 1), (7, 63), (40, 64), (40, 200)])
def test_pairs_are_those_of_all_rows_by_all_rows(rows: int, frames: int) -> None:
    rng = np.random.default_rng(rows)
    near = rng.uniform(0.5, 2, (rows, frames)) * (rng.random((rows, frames)) < 0.3)
    held = rng.uniform(0.5, 2, (rows, rows)) * (rng.random((rows, rows)) < 0.4)
    a, b = np.nonzero(np.triu(held @ held.T, 1))
    votes, views = ((matrix @ matrix.T)[a, b] for matrix in (near, 1.0 * (near > 0)))
    a, b, votes, views = (column[views > 0] for column in (a, b, votes, views))
    found = agreement._pairs(csr_array(near), csr_array(held))
    order = [k for k in np.lexsort((found.b, found.a)) if found.views[k]]
    np.testing.assert_array_equal([found.a[order], found.b[order], found.views[order]], [a, b, views])
    np.testing.assert_allclose(found.share[order], (held @ held.T)[a, b] / votes, atol=1e-8)
