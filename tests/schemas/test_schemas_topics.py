"""The table of topics is consistent, and keys are what Zenoh takes."""

import pytest

import spot3d_schemas
from spot3d_schemas import (
    BRIDGE,
    MESSAGES,
    STAGES,
    TOPICS,
    Message,
    Token,
    alive_key,
    checked_name,
    fleet_key,
    key,
    process_key,
    robot_of,
    token_of,
)


def test_the_table_holds_what_the_dataflow_needs() -> None:
    assert set(TOPICS) == {
        "source/frame",
        "source/preview",
        "source/end",
        "pose/pose",
        "proposals/boxes",
        "heatmap/heat",
        "heatmap/preview",
        "segments/segments",
        "fusion/objects",
        "fusion/progress",
        "fusion/map",
        "fusion/changes",
        "fusion/reset",
        *(f"{stage}/health" for stage in (*STAGES, BRIDGE)),
        *(f"{stage}/about" for stage in STAGES),
    }


@pytest.mark.parametrize("name", sorted(TOPICS))
def test_rows_agree_with_themselves(name: str) -> None:
    topic = TOPICS[name]
    assert topic.name == name
    assert topic.producer in (*STAGES, BRIDGE)
    assert topic.key_template == "spot3d/{robot}/" + name
    assert (topic.rate_hz == 0) == (topic.kind == "query")


def test_keys_differ_and_every_message_has_a_topic() -> None:
    assert len({key("drone", name) for name in TOPICS}) == len(TOPICS)
    models = (item for item in vars(spot3d_schemas).values() if isinstance(item, type) and issubclass(item, Message))
    assert {model.__name__: model for model in models if model is not Message} == MESSAGES


def test_key() -> None:
    assert key("drone-1", "source/frame") == "spot3d/drone-1/source/frame"
    assert fleet_key("pose/health") == "spot3d/*/pose/health"


def test_alive_key() -> None:
    assert alive_key("drone-1", "pose") == "spot3d/drone-1/pose/alive"
    assert alive_key("*", "*") == "spot3d/*/*/alive"
    with pytest.raises(ValueError, match="part of a key"):
        alive_key("a/b", "pose")


@pytest.mark.parametrize("robot", ["", "a/b", "*", "a$", "a#b", "a?", "@x", "a b", "a\n", "x" * 65])
def test_a_robot_name_is_one_chunk_of_a_key(robot: str) -> None:
    with pytest.raises(ValueError, match="part of a key"):
        key(robot, "source/frame")


@pytest.mark.parametrize("robot", ["a", "Drone_1.2-b", "dröhne", "x" * 64])
def test_usual_robot_names_are_taken(robot: str) -> None:
    assert checked_name(robot) == robot


def test_unknown_topic() -> None:
    with pytest.raises(KeyError, match="frames"):
        key("a", "source/frames")


def test_zenoh_takes_every_key() -> None:
    zenoh = pytest.importorskip("zenoh", reason="Zenoh is not installed")
    for name in TOPICS:
        assert zenoh.KeyExpr(fleet_key(name)).includes(zenoh.KeyExpr(key("drone", name)))


def test_keys_of_tokens_say_who_is_there() -> None:
    assert token_of(alive_key("left", "fusion")) == Token("left", "fusion", None)
    assert token_of(process_key("left", "fusion", "ab12")) == Token("left", "fusion", "ab12")
    assert robot_of(key("left", "fusion/objects")) == "left"


@pytest.mark.parametrize(
    "odd",
    [
        "spot3d/**",
        "spot3d/*/fusion/alive",
        "spot3d/a b/fusion/alive",
        "spot3d/a/b/c/alive",
        "a",
        "spot3d/a/b/alive/c/d",
    ],
)
def test_keys_of_others_say_nothing(odd: str) -> None:
    """Anybody may declare any token, and one with a wildcard meets everybody's subscription."""
    assert token_of(odd) is None
    assert robot_of("spot3d/**") is robot_of("spot3d/*/fusion/objects") is robot_of("spot3d") is None
