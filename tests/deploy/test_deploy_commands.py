"""Every command of spot3d in README.md and docs/ is one that its command line understands."""

import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer
from typer.main import get_command

from spot3d.cli.app import app

ROOT = Path(__file__).parents[2]
PAGES = {
    page.relative_to(ROOT): page.read_text() for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
}
LOOP = re.compile(r"for (\w+) in ([^;]+); do (.+?) done")
COMMAND = re.compile(r"(?:^|(?<!from)[\s;])spot3d (\w.*?)(?=\s+#|\s*[;&|]|$)")


def unrolled(line: str) -> str:
    """The line with the loops of the shell gone through."""
    return LOOP.sub(lambda loop: "".join(loop[3].replace(f"${loop[1]}", name) + "; " for name in loop[2].split()), line)


def commands_in(line: str) -> list[str]:
    return COMMAND.findall(unrolled(" ".join(line.split())))


def commands() -> Iterator[tuple[str, bool]]:
    """Each command, and whether it stands on a line of its own, to be typed as it is."""
    for page in PAGES.values():
        text = re.sub(r"```.*?```", "", page, flags=re.DOTALL).replace("\\\n", "")
        for line in re.findall(r"^    .*", text, re.MULTILINE):
            yield from ((command, True) for command in commands_in(line))
        for code in re.findall(r"`([^`]+)`", text):
            yield from ((command, False) for command in commands_in(code))


def refusal(command: str) -> str:
    """What the command line says to this command before it would do anything; empty where it understands it."""
    name, *arguments = shlex.split(command)
    try:
        get_command(app).commands[name].make_context(name, arguments)
    except typer.BadParameter as error:
        return error.format_message()
    return ""


@pytest.mark.parametrize(("command", "whole"), sorted(set(commands())))
def test_a_command_is_understood(command: str, whole: bool) -> None:
    said = refusal(command)
    if said.startswith("Missing argument") and not whole:
        said = ""  # amid a sentence a command may be named without what it is given
    assert not said


def test_extras_that_pages_name_exist() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    found = re.findall(r"'(?:\.|spot3d)\[([\w,]+)\]'", "\n".join(PAGES.values()))
    named = {extra for names in found for extra in names.split(",")}
    assert {"all", "dashboard"} <= named <= set(extras)


def test_commands_are_found_in_loops_and_after_other_words() -> None:
    found = {command for command, whole in commands() if whole}
    assert {"run realsense --dashboard", "fusion --settings deploy/settings/ground.toml"} <= found
    assert "run /recording --live --rate 30 --out /results/flight" in found
    assert commands_in("spot3d router & spot3d fusion --lossless  # a word") == ["router", "fusion --lossless"]
