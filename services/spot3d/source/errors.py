"""The source stage's one error."""


class SourceError(Exception):
    """The input cannot be played; the message says what is wrong and what to do about it."""


UNREADABLE = "cannot be read"
"""Why a frame of an input is not played: its files are missing or broken."""
