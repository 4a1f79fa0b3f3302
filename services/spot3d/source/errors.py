"""The source stage's one error."""


class SourceError(Exception):
    """The input cannot be played; the message says what is wrong and what to do about it."""
