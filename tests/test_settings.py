import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from spot3d.settings import PRESETS, InvalidSettingsError, load_settings, to_toml, without_settings


@pytest.fixture(autouse=True)
def no_settings_in_the_environment(monkeypatch):
    import os

    for name in set(os.environ) - set(without_settings(os.environ)):
        monkeypatch.delenv(name)


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_each_layer_wins_over_the_one_below(tmp_path, monkeypatch):
    assert load_settings().fusion.colour_gate == 0.2
    assert load_settings(preset="paper").fusion.colour_gate == 0.05
    file = written(tmp_path, 'preset = "paper"\n[fusion]\ncolour_gate = 0.07\ntau = 3.0\n')
    assert load_settings(file).fusion.colour_gate == 0.07
    monkeypatch.setenv("SPOT3D_FUSION__COLOUR_GATE", "0.08")
    assert load_settings(file).fusion.colour_gate == 0.08
    settings = load_settings(file, overrides={"fusion": {"colour_gate": 0.09}})
    assert settings.fusion.colour_gate == 0.09
    assert settings.fusion.tau == 3.0, "a layer above replaces single values, not tables"
    assert settings.fusion.clustering == "density", "and the preset that the file names stays below all"


@pytest.mark.parametrize(
    ("endpoint", "valid"),
    [
        ("tcp/ground-station:7447", True),
        ("tls/[::1]:7447#so_sndbuf=65536", True),
        ("tcp/127.0.0.1:0", True),
        ("unixsock-stream//run/spot3d/stages", True),
        ("tcp/10.0.0.1:7447?rel=0;prio=1-3#so_sndbuf=65536;so_rcvbuf=65536", True),
        ("tls/10.0.0.1:7447#root_ca_certificate_base64=bm9uZQ==", True),
        ("tcp/10.0.0.1", False),
        ("tcp/:7447", False),
        ("tcp/::1:7447", False),
        ("tcp/10.0.0.1:http", False),
        ("tcp/10.0.0.1:65536", False),
        ("udp/10.0.0.1:7447", False),
        ("tcp/10.0.0.1:7447#", False),
        ("tcp/10.0.0.1:7447?#so_sndbuf=65536", False),
        ("tcp/10.0.0.1:7447#=", False),
        ("tcp/10.0.0.1:7447#so_sndbuf=65536?rel=1", False),
        ("tcp/10.0.0.1:7447?rel=9", False),
        ("tcp/10.0.0.1:7447?prio=1-3;rel=best_effort", False),
        ("unixsock-stream//run/spot3d/stages#", False),
    ],
)
@pytest.mark.parametrize(("section", "name"), [("link", "listen"), ("link", "connect"), ("bridge", "ground")])
def test_endpoints_have_an_address_and_a_port(section, name, endpoint, valid):
    overrides = {section: {name: (endpoint,)}}
    if valid:
        # Who listens at tls/... needs a certificate besides.
        overrides["link"] = overrides.get("link", {}) | {"certificate": "own.pem", "key": "own.key"}
        load_settings(overrides=overrides)
    else:
        with pytest.raises(InvalidSettingsError, match=rf"{section}.{name}.0: expected tcp/ADDRESS:PORT with a port"):
            load_settings(overrides=overrides)


def test_the_papers_preset_keeps_the_papers_values_in_nested_settings():
    assert load_settings(preset="paper").proposals.edges.min_magnitude == 0.1
    edges = {"proposals": {"edges": {"colour_contrast": 40.0}}}
    assert load_settings(preset="paper", overrides=edges).proposals.edges.min_magnitude == 0.1


def test_nested_and_listed_values_come_from_the_environment(monkeypatch):
    monkeypatch.setenv("SPOT3D_PROPOSALS__EDGES__COLOUR_CONTRAST", "40.0")
    monkeypatch.setenv("SPOT3D_LINK__CONNECT", '["tcp/10.0.0.1:7447"]')
    monkeypatch.setenv("SPOT3D_PRESET", "paper")
    settings = load_settings()
    assert settings.proposals.edges.colour_contrast == 40.0
    assert settings.link.connect == ("tcp/10.0.0.1:7447",)
    assert settings.preset == "paper"
    assert settings.proposals.alpha == 0.65


@pytest.mark.parametrize("preset", sorted(PRESETS))
def test_toml_round_trip(preset, tmp_path):
    settings = load_settings(preset=preset, overrides={"link": {"robot": 'dröhne"1\\', "listen": ["tcp/[::]:1"]}})
    text = to_toml(settings)
    assert load_settings(written(tmp_path, text)) == settings
    assert tomllib.loads(text)["fusion"]["tau"] == settings.fusion.tau
    assert "eps_Z" in text, "the paper's symbols are in the file"


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path):
    file = written(tmp_path, "")
    file.write_text("[fusion]\ntau = 7\n", encoding="utf-8-sig")
    assert load_settings(file).fusion.tau == 7


def test_a_file_in_another_encoding_is_refused_with_what_to_do(tmp_path):
    file = written(tmp_path, "")
    file.write_text("# K\u00fcche\n", encoding="latin-1")
    with pytest.raises(InvalidSettingsError, match=r"is not valid TOML: .*; save it as UTF-8$"):
        load_settings(file)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[fusion]\ntau = -1\n", ("fusion.tau", "-1", "mine.toml")),
        ("[fusion]\ntua = 1\n", ("fusion.tua", "no such setting", "mine.toml")),
        ("[proposals.edges]\nmin_magnitude = 'x'\n", ("proposals.edges.min_magnitude", "'x'")),
        ("[link]\nconnect = ['tcp/a:1', 'nonsense']\n", ("link.connect.1", "nonsense", "mine.toml")),
        ("[link]\nconnect = 'tcp/a:1'\n", ("link.connect: expected a list", 'such as ["a", "b"]', "tcp/a:1", "mine")),
        ("[heat]\n", ("heat", "no such setting")),
        ("preset = 'mine'\n", ("preset", "mine", "default, paper")),
        ("[fusion\n", ("not valid TOML",)),
    ],
)
def test_errors_name_the_field_and_the_place(text, named, tmp_path):
    with pytest.raises(InvalidSettingsError) as error:
        load_settings(written(tmp_path, text))
    assert "\n" not in str(error.value)
    for part in named:
        assert part in str(error.value)


@pytest.mark.parametrize(
    ("name", "value", "named"),
    [
        ("SPOT3D_FUSION__TAU", "much", ("fusion.tau", "'much'", "the environment")),
        ("SPOT3D_FUSOIN__TAU", "1", ("SPOT3D_FUSOIN__TAU", "no section", "FUSION")),
        ("SPOT3D_LINK__CONNECT", "[", ("environment", "link")),
        ("SPOT3D_LINK__CONNECT", "tcp/a:1", ("link.connect: expected a list", "'tcp/a:1'", "the environment")),
        ("SPOT3D_LINK__CONNECT", "[tcp/a:1]", ("link.connect: expected a list", "in double quotes", "[tcp/a:1]")),
        ("SPOT3D_LINK", "tcp/a:1", ("link: Input should be a valid dictionary", "tcp/a:1", "environment")),
        ("SPOT3D_FUSION_TAU", "5", ("SPOT3D_FUSION_TAU in", "two underscores", "SPOT3D_FUSION__TAU")),
        ("spot3d_link_snapshot_folder", "x", ("spot3d_link_snapshot_folder in", "SPOT3D_LINK__SNAPSHOT_FOLDER")),
        ("SPOT3D_PROPOSALS_EDGES__COLOUR_CONTRAST", "4", ("SPOT3D_PROPOSALS__EDGES__COLOUR_CONTRAST",)),
    ],
)
def test_errors_in_the_environment(name, value, named, monkeypatch):
    monkeypatch.setenv(name, value)
    with pytest.raises(InvalidSettingsError) as error:
        load_settings()
    for part in named:
        assert part in str(error.value)


def test_a_table_whose_values_do_not_go_together_is_not_printed() -> None:
    with pytest.raises(InvalidSettingsError) as error:
        load_settings(overrides={"link": {"mode": "router", "listen": ("tls/127.0.0.1:1",)}})
    assert str(error.value).startswith("link: listening at tls/... or quic/... needs a certificate and its key; make")
    assert str(error.value).endswith("with spot3d certificates (set in the command line)")


def test_sizes_of_objects_are_set_once_for_all_stages(monkeypatch, tmp_path):
    monkeypatch.setenv("SPOT3D_SIZE_MAX", "2.0")
    settings = load_settings(overrides={"segments": {"size_max": 3.0}, "size_min": 0.01})
    sized = (settings.proposals, settings.heatmap, settings.segments, settings.fusion)
    assert [section.size_min for section in sized] == [0.01] * 4
    assert [section.size_max for section in sized] == [2.0, 2.0, 3.0, 2.0], "a stage may have its own"
    text = to_toml(settings)
    assert text.count("size_max = ") == 2, "what all share stands there once"
    monkeypatch.delenv("SPOT3D_SIZE_MAX")
    assert load_settings(written(tmp_path, text)) == settings


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InvalidSettingsError, match=r"nowhere\.toml"):
        load_settings(tmp_path / "nowhere.toml")


def test_what_is_not_finite_round_trips(tmp_path):
    # TOML knows inf; JSON would not.
    text = to_toml(load_settings(overrides={"fusion": {"range_max": math.inf}}))
    assert load_settings(written(tmp_path, text)).fusion.range_max == math.inf


def test_other_variables_are_left_alone():
    environment = {"SPOT3D_DATA": "d", "SPOT3D_FUSION__TAU": "1", "SPOT3D_PRESET": "paper", "HOME": "h"}
    assert without_settings(environment) == {"SPOT3D_DATA": "d", "HOME": "h"}


@pytest.mark.parametrize(
    "name",
    ["SPOT3D_DASHBOARD_PORT", "SPOT3D_DATA", "SPOT3D_FUZZ_SECONDS", "SPOT3D_CONTAINERS", "SPOT3D_SHARED_MEMORY"],
)
def test_variables_that_are_no_settings_are_not_refused(name, monkeypatch):
    monkeypatch.setenv(name, "8088")
    load_settings()


def test_a_greatest_size_below_the_least_is_refused() -> None:
    with pytest.raises(InvalidSettingsError, match=r"size_max.*must be greater than size_min, which is 2 m"):
        load_settings(overrides={"size_min": 2.0, "size_max": 1.0})


@pytest.mark.parametrize("section", ["proposals", "heatmap", "segments", "fusion"])
@pytest.mark.parametrize("sizes", [{"size_min": 0.4, "size_max": 0.3}, {"size_max": 0.02}, {"size_min": 3.0}])
def test_a_stage_has_no_greatest_size_below_the_least_either(section: str, sizes: dict[str, float]) -> None:
    with pytest.raises(InvalidSettingsError, match=rf"{section}\.size_max: must be greater than size_min"):
        load_settings(overrides={section: sizes})


def test_sizes_for_every_stage_go_with_a_stages_own() -> None:
    with pytest.raises(InvalidSettingsError, match=r"^size_max: must be greater than size_min, which is 3 m, got 1\.0"):
        load_settings(overrides={"size_min": 3.0})
    with pytest.raises(
        InvalidSettingsError, match=r"^fusion\.size_max: must be greater than size_min, which is 0\.3 m, got 0\.2"
    ):
        load_settings(overrides={"size_min": 0.3, "fusion": {"size_max": 0.2}})
    assert load_settings(overrides={"size_min": 0.3, "fusion": {"size_max": 0.4}}).fusion.size_min == 0.3


def test_a_bridge_between_stages_that_there_are_not_is_refused() -> None:
    said = r"bridge\.stages\.1: unknown stage; choose from source, .*, fusion, got 'heatmpa'"
    with pytest.raises(InvalidSettingsError, match=said):
        load_settings(overrides={"bridge": {"stages": ("source", "heatmpa")}})


@pytest.mark.parametrize(
    ("name", "refused", "accepted"),
    [
        ("proposals.alpha", (0.91, 0.95, 1.0), (0.4, 0.65, 0.9)),
        ("proposals.edges.colour_contrast", (1e-6, 0.9, 1001.0, math.inf), (1.0, 80.0, 160.0, 1000.0)),
        ("bridge.silence_s", (1e-9, 0.19), (0.2, 60.0)),
        ("fusion.density_radius", (0.21, 10.0), (0.02, 0.2)),
        ("fusion.density_cell", (1e-300, 9e-4), (0.0, 1e-3, 0.1)),
        ("fusion.plane_triples", (100_001, 1_000_000), (10, 100_000)),
        ("segments.plane_triples", (100_001,), (10, 100_000)),
        ("segments.region", (0.051, 1.0), (1e-3, 0.05)),
        *((f"{section}.noise_gate", (10.1, 1e30), (0.0, 9.0, 10.0)) for section in ("segments", "fusion")),
        *((f"{section}.plane_distance", (1e-30, 9e-5, 0.11), (1e-4, 0.1)) for section in ("segments", "fusion")),
        *((f"{section}.grazing_cos", (1e-200, 9e-3), (0.0, 0.01)) for section in ("segments", "fusion")),
    ],
)
def test_what_no_stage_can_compute_with_is_refused(
    name: str, refused: tuple[float, ...], accepted: tuple[float, ...]
) -> None:
    def given(value: float) -> dict[str, Any]:
        overrides: Any = value
        for part in reversed(name.split(".")):
            overrides = {part: overrides}
        return dict(overrides)

    for value in accepted:
        load_settings(overrides=given(value))
    for value in refused:
        with pytest.raises(InvalidSettingsError, match=rf"^{re.escape(name)}: .*{re.escape(str(value))}"):
            load_settings(overrides=given(value))


def test_a_preset_that_is_no_name_is_refused(tmp_path):
    with pytest.raises(InvalidSettingsError, match=r"preset .* does not exist"):
        load_settings(written(tmp_path, 'preset = ["paper"]\n'))
