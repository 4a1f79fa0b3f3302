"""Parses names of built-in scenes: seed and kind."""

import re
from dataclasses import dataclass
from typing import Literal, get_args

SceneKind = Literal["table", "cluttered", "desk", "near", "shelf", "bin", "room", "changing"]
DEFAULT_KIND: SceneKind = "table"
_SUFFIXES: dict[str, SceneKind] = {kind: kind for kind in get_args(SceneKind) if kind != DEFAULT_KIND}
_KIND = rf"(?::(?P<kind>{'|'.join(_SUFFIXES)}))?"
_ONE = re.compile(rf"scene(?::(?P<seed>\d+))?{_KIND}")
_MANY = re.compile(rf"scenes:(?P<count>[1-9]\d?){_KIND}")
_ENDINGS = [f":{kind}" for kind in _SUFFIXES]
_WITH = f"each with {', '.join(_ENDINGS[:-1])} or {_ENDINGS[-1]}"
SPELLINGS = f"scene, scene:SEED, and {_WITH} (SEED: 0, 1, ...)"
SPELLINGS_OF_MANY = f"scenes:COUNT, {_WITH} (COUNT: 1 to 99)"


@dataclass(frozen=True, slots=True)
class SceneName:
    """Seed and kind of a built-in scene."""

    seed: int = 0
    kind: SceneKind = DEFAULT_KIND

    def __str__(self) -> str:
        return f"scene:{self.seed}" + ("" if self.kind == DEFAULT_KIND else f":{self.kind}")


def parse_scene_name(name: str) -> SceneName | None:
    """Seed and kind from a scene's name. None if it names no built-in scene."""
    if (match := _ONE.fullmatch(name)) is None:
        return None
    return SceneName(int(match["seed"] or 0), _SUFFIXES.get(match["kind"], DEFAULT_KIND))


def scene_names(name: str) -> list[str] | None:
    """The scenes that a name stands for: `scenes:5` is `scene:0` .. `scene:4`. None if it names no scene."""
    if (match := _MANY.fullmatch(name)) is not None:
        return [str(SceneName(seed, _SUFFIXES.get(match["kind"], DEFAULT_KIND))) for seed in range(int(match["count"]))]
    return None if parse_scene_name(name) is None else [name]
