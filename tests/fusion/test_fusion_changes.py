"""What changed in the map since somebody asked: each asker gets every change once, in bounded answers."""

import numpy as np
import pytest
import zenoh

from spot3d.camera import Intrinsics
from spot3d.camera_pose import CameraPose
from spot3d.fusion.fusion import Fusion
from spot3d.fusion.map.changes import ChangeLog
from spot3d.fusion.map.map_arrays import COLUMNS, FIRST, FREQUENCY, HEAT, R, X
from spot3d.fusion.map_answers import changes_message
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.supports import RecentSupports
from spot3d_schemas import Header, MapChanges

LIMIT = 100


def rows_seen(frequencies: list[int], heat: float = 0.0) -> np.ndarray:
    rows = np.zeros((len(frequencies), COLUMNS), np.float32)
    rows[:, FREQUENCY], rows[:, HEAT] = frequencies, heat
    return rows


def asked(changes: ChangeLog, rows: np.ndarray, since: int, most: int = LIMIT) -> tuple[list[int], int, int]:
    chosen, cursor, behind = changes.after(since, most, rows, least=2.0, tau=0.0)
    return chosen.tolist(), cursor, behind


def answer(fusion: Fusion, parameters: dict[str, str]) -> MapChanges:
    header = Header(robot="robot", seq=0, stamp_ns=1, frame_id="camera")
    return changes_message(fusion, zenoh.Parameters(parameters), header, "a")


def test_every_change_is_told_once() -> None:
    changes, rows = ChangeLog(LIMIT), rows_seen([])
    assert asked(changes, rows, 0) == ([], 0, 0)
    rows = rows_seen([1, 2, 4])
    told, cursor, behind = asked(changes, rows, 0)
    assert (told, behind) == ([1, 2], 0), "a point seen once does not count yet"
    assert asked(changes, rows, cursor) == ([], cursor, 0)
    rows[:, FREQUENCY] = (2, 3, 8)  # begins to count; hardly seen more; seen twice as often
    told, later, _ = asked(changes, rows, cursor)
    assert told == [0, 2]
    assert asked(changes, rows, 0)[0] == [1, 0, 2], "who knows nothing gets all, the first to change first"
    assert asked(changes, rows, cursor)[0] == [0, 2], "and each asker goes by its own cursor"
    assert changes.as_sent(np.array([2]))[1].tolist() == [8]
    assert asked(changes, rows, later)[0] == []


@pytest.mark.parametrize(("heat", "told"), [(0.52, False), (0.6, True)])
def test_heat_is_told_where_people_would_see_it(heat: float, told: bool) -> None:
    changes, rows = ChangeLog(LIMIT), rows_seen([10], heat=5.0)
    cursor = asked(changes, rows, 0)[1]
    rows[:, HEAT] = 10 * heat
    assert bool(asked(changes, rows, cursor)[0]) == told
    assert changes.as_sent(np.array([0]))[0][0] == (153 if told else 128)


def test_a_point_that_is_no_more_and_one_in_its_place() -> None:
    changes, rows = ChangeLog(LIMIT), rows_seen([9, 9])
    cursor = asked(changes, rows, 0)[1]
    rows[0, FREQUENCY] = 0
    gone, cursor, _ = asked(changes, rows, cursor)
    assert gone == [0]
    assert changes.as_sent(np.array([0]))[1][0] == 0
    rows[:, FREQUENCY] = (3, 4)
    assert asked(changes, rows, cursor)[0] == [0, 1], "both are other points than before"


def test_a_point_in_anothers_place_is_told_however_alike_they_are() -> None:
    changes, rows = ChangeLog(LIMIT), rows_seen([9, 9])
    cursor = asked(changes, rows, 0)[1]
    rows[1, FIRST] = 7
    told, cursor, _ = asked(changes, rows, cursor)
    assert told == [1]
    assert asked(changes, rows, cursor)[0] == [], "once"


def test_whoever_asks_a_full_map_knows_where_its_points_are() -> None:
    """A camera goes from place to place, and each takes the room of one before; all have the same heat."""
    fusion = Fusion(FusionSettings(map_limit=1000, lattice_width=40))
    camera, pose, known, since = Intrinsics(24.0, 24.0, 11.5, 11.5, 24, 24), np.eye(4), {}, 0
    colour, depth = np.full((*camera.shape, 3), 100, np.uint8), np.ones(camera.shape, np.float32)
    for place in range(6):
        pose[0, 3] = 2.0 * place
        fusion.fuse(colour, depth, np.zeros(camera.shape, np.uint8), camera, CameraPose(pose))
        parameters = {"generation": str(fusion.map_changes.generation), "since": str(since)}
        message = answer(fusion, parameters)
        since = message.cursor
        assert message.behind == 0
        known |= dict(zip(message.number.tolist(), message.xyz.tolist(), strict=True))
    rows = fusion.heatmap.points()
    assert fusion.heatmap.evicted > 100
    assert np.abs(rows[:, X : X + 3] - [known[row] for row in range(len(rows))]).max() < 0.05


def test_answers_are_bounded_and_complete() -> None:
    changes, rows, since, told = ChangeLog(LIMIT), rows_seen([5] * 90), 0, []
    for left in (60, 30, 0):
        chosen, since, behind = asked(changes, rows, since, most=30)
        assert (behind, len(chosen) <= 30) == (left, True)
        told += chosen
    assert sorted(told) == list(range(90))


def test_another_map_has_another_generation() -> None:
    changes = ChangeLog(LIMIT)
    for frequency in (9, 18, 36):
        rows = rows_seen([frequency])
        asked(changes, rows, 0)
    before = changes.generation
    changes.clear()
    assert changes.generation != before
    told, cursor, _ = asked(changes, rows, 0)
    assert (told, cursor) == ([0], 1), "numbers count from one again"


def fused() -> Fusion:
    fusion = Fusion(FusionSettings(map_limit=1000))
    rows = rows_seen([4, 8, 16], heat=4.0)
    rows[:, X : X + 3] = np.arange(9).reshape(3, 3)
    rows[:, R : R + 3] = (10, 20, 300)
    fusion.heatmap.restore(rows, np.full(3, -1, np.int64))
    fusion.frame_count = 40
    return fusion


@pytest.mark.parametrize("since", ["", "0", "-3", "1e9", "x" * 1000])
def test_the_message_says_all_to_whoever_has_nothing(since: str) -> None:
    fusion = fused()
    parameters = {"generation": str(fusion.map_changes.generation), "since": since}
    message = answer(fusion, parameters)
    assert message.number.tolist() == [0, 1, 2]
    np.testing.assert_array_equal(message.xyz, np.arange(9).reshape(3, 3))
    assert message.rgb.tolist() == [[10, 20, 255]] * 3
    assert message.frequency.tolist() == [4, 8, 16]
    assert message.heat.tolist() == [170, 102, 57], "tau is 2: 5 % of 40 frames"
    assert (message.behind, message.total) == (0, 3)
    rest = answer(fusion, parameters | {"since": str(message.cursor)})
    assert (len(rest.number), rest.cursor) == (0, message.cursor)
    assert len(answer(fusion, parameters | {"since": str(message.cursor), "generation": "7"}).number)
    assert answer(fusion, parameters | {"limit": "1"}).behind == 2
    none = answer(fusion, parameters | {"limit": "0"})
    assert (len(none.number), none.cursor, none.behind) == (1, 1, 2), "nothing is skipped"
    for since in ("9" * 19, str(2**63 - 1)):
        known = {"generation": str(message.generation), "since": since}
        ahead = answer(fusion, known)
        assert (len(ahead.number), ahead.cursor) == (0, message.cursor), "nobody has more than there is"


def test_supports_seen_again_replace_themselves() -> None:
    supports, eye = RecentSupports(), np.array([0.0, 0.0, 1.5])
    tilted = np.array([0.0, np.sin(0.05), np.cos(0.05), -0.71])
    for plane in ([0, 0, 1, -0.7], [0, 0, 1, 0], tilted):
        supports.add(np.asarray(plane, np.float64), eye)
    np.testing.assert_allclose(supports.planes(), [[0, 0, 1, 0], tilted])
    for height in range(20):
        supports.add(np.array([0.0, 0.0, 1.0, -float(height)]), eye)
    assert supports.planes()[-1].tolist() == [0, 0, 1, -19]
    assert len(supports.planes()) == 8
