"""All settings of spot3d in one model: presets, a TOML file, the environment and the command line."""

import json
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, Field, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_settings import BaseSettings, EnvSettingsSource, PydanticBaseSettingsSource, SettingsConfigDict

from spot3d.bridge.settings import BridgeSettings
from spot3d.dashboard.settings import DashboardSettings
from spot3d.dataflow.settings import LinkSettings
from spot3d.file_errors import why
from spot3d.fusion.settings import PAPER as PAPER_FUSION
from spot3d.fusion.settings import FusionSettings
from spot3d.heatmap.settings import PAPER as PAPER_HEATMAP
from spot3d.heatmap.settings import HeatmapSettings
from spot3d.object_size import SIZE_MAX, SIZE_MIN, SizeMax
from spot3d.pose.settings import PoseSettings
from spot3d.proposals.settings import PAPER as PAPER_PROPOSALS
from spot3d.proposals.settings import ProposalSettings
from spot3d.security.access import AccessSettings
from spot3d.segments.settings import PAPER as PAPER_SEGMENTS
from spot3d.segments.settings import SegmentsSettings
from spot3d.source.settings import SourceSettings

Preset = Literal["default", "paper"]
ENVIRONMENT_PREFIX = "SPOT3D_"
_NO_SETTINGS = ("SPOT3D_DASHBOARD_PORT",)
"""Variables of docker-compose.yml that look like a setting with one underscore too few."""

Layer = dict[str, Any]

_SIZES = ("size_min", "size_max")
_SIZED = ("proposals", "heatmap", "segments", "fusion")
"""Sections with these settings."""


class Settings(BaseSettings):
    """Every stage's settings and the links between them; built by `load_settings`."""

    model_config = SettingsConfigDict(
        frozen=True, extra="forbid", env_prefix=ENVIRONMENT_PREFIX, env_nested_delimiter="__"
    )

    preset: Preset = Field(
        "default", description="values of settings that are not given: default (measured better) or paper (the paper's)"
    )
    size_min: float = Field(SIZE_MIN, ge=0, description="eps_min: least size of an object, metres, for all stages")
    size_max: SizeMax = Field(SIZE_MAX, gt=0, description="eps_max: greatest size of an object, metres, for all stages")
    source: SourceSettings = SourceSettings()
    pose: PoseSettings = PoseSettings()
    proposals: ProposalSettings = ProposalSettings()
    heatmap: HeatmapSettings = HeatmapSettings()
    segments: SegmentsSettings = SegmentsSettings()
    fusion: FusionSettings = FusionSettings()
    link: LinkSettings = LinkSettings()
    access: AccessSettings = AccessSettings()
    dashboard: DashboardSettings = DashboardSettings()
    bridge: BridgeSettings = BridgeSettings()

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Only what `load_settings` gives, which has read the environment."""
        return (init_settings,)

    def changed(self, section: str, **values: Any) -> "Settings":
        """A copy with these values of one section, which are not validated."""
        return self.model_copy(update={section: getattr(self, section).model_copy(update=values)})

    @model_validator(mode="before")
    @classmethod
    def _sizes_for_every_stage(cls, given: Layer) -> Layer:
        """Copy the sizes of objects to each section that sets none of its own."""
        sizes = {name: given[name] for name in _SIZES if name in given}
        return _merged({section: dict(sizes) for section in _SIZED}, given) if sizes else given


PRESETS: dict[str, Layer] = {
    "default": {},
    "paper": {
        "preset": "paper",
        "pose": {"given_sigma": 0.0, "depth_bend_sigma": 0.0},
        "proposals": PAPER_PROPOSALS.model_dump(exclude_unset=True),
        "segments": PAPER_SEGMENTS.model_dump(exclude_unset=True),
        "heatmap": PAPER_HEATMAP.model_dump(exclude_unset=True),
        "fusion": PAPER_FUSION.model_dump(exclude_unset=True),
    },
}


class InvalidSettingsError(ValueError):
    """A setting is unknown or has no valid value; the message names the field and where it was set."""


def load_settings(
    file: Path | None = None, preset: Preset | None = None, overrides: Mapping[str, Any] | None = None
) -> Settings:
    """Settings by precedence: `overrides` > environment > TOML `file` > preset.

    overrides: nested by section, as the file is. The preset is `preset`, or what the environment or the file
    names. Environment: `SPOT3D_FUSION__TAU=5`. Raises InvalidSettingsError.
    """
    layers = {"the command line": dict(overrides or {}), "the environment": _environment()}
    if file is not None:
        layers[str(file)] = read_toml(file)
    named = preset or next((layer["preset"] for layer in layers.values() if "preset" in layer), "default")
    if not isinstance(named, str) or named not in PRESETS:
        raise InvalidSettingsError(f"preset {named!r} does not exist; choose one of {', '.join(PRESETS)}")
    merged: Layer = {}
    for layer in (PRESETS[named], *reversed(layers.values()), {"preset": named}):
        merged = _merged(merged, layer)
    try:
        return Settings(**merged)
    except ValidationError as error:
        raise InvalidSettingsError(_first_error(error, layers)) from error


def read_toml(file: Path) -> Layer:
    """The tables of a TOML file. Raises InvalidSettingsError, naming the file and what is wrong with it."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InvalidSettingsError(f"cannot read settings from {file}: {why(error)}") from error
    except UnicodeDecodeError as error:
        raise InvalidSettingsError(f"{file} is not valid TOML: {error}; save it as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise InvalidSettingsError(f"{file} is not valid TOML: {error}") from error


def to_toml(settings: BaseModel) -> str:
    """TOML that `load_settings` reads back to equal settings; each value has its description as a comment."""
    shared = {name: getattr(settings, name) for name in _SIZES if name in type(settings).model_fields}
    return "\n".join(_toml_lines(settings, "", shared)) + "\n"


def without_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """An environment without spot3d's settings, for processes that are given resolved settings as a file."""
    return {name: value for name, value in environment.items() if not _is_setting(name)}


def _is_setting(name: str) -> bool:
    rest = name.upper().removeprefix(ENVIRONMENT_PREFIX)
    return name.upper().startswith(ENVIRONMENT_PREFIX) and ("__" in rest or rest.lower() in Settings.model_fields)


def _environment() -> Layer:
    """The settings in the environment. Refuses names that would be ignored: of no section, or with one underscore."""
    one_underscore = re.compile(rf"{ENVIRONMENT_PREFIX}({'|'.join(Settings.model_fields)})_([^_].*)", re.IGNORECASE)
    for name in os.environ:
        if (match := one_underscore.fullmatch(name)) and name not in _NO_SETTINGS:
            meant = f"{ENVIRONMENT_PREFIX}{match[1]}__{match[2]}".upper()
            raise InvalidSettingsError(
                f"{name} in the environment: two underscores must follow the section's name, as in {meant}"
            )
        section = name.upper().removeprefix(ENVIRONMENT_PREFIX).split("__")[0].lower()
        if _is_setting(name) and section not in Settings.model_fields:
            known = ", ".join(part.upper() for part in Settings.model_fields)
            raise InvalidSettingsError(f"{name} in the environment: there is no section {section}; use one of {known}")
    return _Environment(Settings)()


class _Environment(EnvSettingsSource):
    """Leaves a list or table that is no JSON as it is, so that it is refused like any other value, by its name."""

    def decode_complex_value(self, field_name: str, field: FieldInfo, value: Any) -> Any:
        try:
            return super().decode_complex_value(field_name, field, value)
        except ValueError:
            return value


def _merged(below: Layer, above: Layer) -> Layer:
    """Both layers; where they disagree, the one above wins, table by table."""
    result = dict(below)
    for name, value in above.items():
        old = result.get(name)
        result[name] = _merged(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return result


def _first_error(error: ValidationError, layers: Mapping[str, Layer]) -> str:
    """`section.field: what is wrong, got value (where it was set)`."""
    first = error.errors()[0]
    path = [str(part) for part in first["loc"]]
    origin = next((name for name, layer in layers.items() if _holds(layer, path)), "the preset")
    if first["type"] == "extra_forbidden":
        return f"{'.'.join(path)}: there is no such setting (set in {origin}); `spot3d settings` lists all"
    wrong, given = first["msg"].removeprefix("Value error, "), repr(first["input"])
    if first["type"] == "tuple_type":
        wrong = 'expected a list, in square brackets and with its texts in double quotes, such as ["a", "b"]'
    got = "" if isinstance(first["input"], dict) else f", got {given[:80]}"  # of a table, `wrong` says which value
    return f"{'.'.join(path)}: {wrong}{got} (set in {origin})"


def _holds(layer: Any, path: list[str]) -> bool:
    for part in path:
        if not isinstance(layer, dict):
            break  # the rest of the path points into a value, such as an item of a list
        if part not in layer:
            return False
        layer = layer[part]
    return True


def _toml_lines(model: BaseModel, table: str, shared: Layer) -> list[str]:
    """Lines of a table and those below it; what a table only repeats of `shared` is left out."""
    lines = [f"\n[{table}]"] if table else []
    inner: list[str] = []
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            inner += _toml_lines(value, f"{table}.{name}" if table else name, shared)
        elif table and name in shared and value == shared[name]:
            continue
        elif value is not None:  # TOML knows no null: absent means the default, which None always is here
            comment = f"  # {' '.join(field.description.split())}" if field.description else ""
            lines.append(f"{name} = {_toml_value(value)}{comment}")
    return lines + inner


def _toml_value(value: Any) -> str:
    if isinstance(value, float):
        return repr(value)  # JSON has another name for infinity
    # Other JSON is valid TOML, except that TOML wants DEL escaped in strings.
    return json.dumps(value, ensure_ascii=False, default=str).replace("\x7f", "\\u007F")
