"""A finding of the doctor."""

from dataclasses import dataclass
from typing import Literal

Level = Literal["ok", "note", "problem"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at. remedy: what to do; empty where nothing is to be done.

    note: works, and is worth knowing. problem: something does not work, or will not for long.
    """

    level: Level
    what: str
    text: str
    remedy: str = ""


def checked(bad: bool, what: str, text: str, remedy: str) -> Finding:
    """A problem with its remedy if it is bad; otherwise ok."""
    return Finding("problem", what, text, remedy) if bad else Finding("ok", what, text)
