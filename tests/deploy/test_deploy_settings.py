"""The example settings are settings, and say nothing that another process of the same link contradicts."""

from pathlib import Path

import pytest

from spot3d.settings import load_settings

FOLDER = Path(__file__).parents[2] / "deploy" / "settings"
NAMES = ("one-machine", "drone", "drone-heatmap", "ground")


@pytest.fixture(autouse=True)
def _no_settings_of_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    for section in ("ROBOT", "CONNECT", "DELIVERY"):
        monkeypatch.delenv(f"SPOT3D_LINK__{section}", raising=False)


def test_every_example_is_tested() -> None:
    assert {path.stem for path in FOLDER.glob("*.toml")} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_example_loads_for_a_client_of_its_own_machine(name: str) -> None:
    link = load_settings(FOLDER / f"{name}.toml").link
    assert (link.mode, link.connect) == ("client", ("tcp/127.0.0.1:7447",))


def test_both_sides_speak_of_the_same_robot_and_only_what_crosses_the_radio_is_compressed() -> None:
    links = {name: load_settings(FOLDER / f"{name}.toml").link for name in ("drone", "drone-heatmap", "ground")}
    assert {(link.robot, link.delivery) for link in links.values()} == {("drone", "live")}
    assert [name for name, link in links.items() if link.thin_link] == ["drone-heatmap"]
