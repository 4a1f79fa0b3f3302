"""The source stage's exception, and the reasons why frames of an input are not played."""


class SourceError(Exception):
    """The input cannot be played; the message says what is wrong and what to do about it."""


UNREADABLE = "cannot be read"
"""A frame's files are missing or broken."""
UNSENDABLE = "cannot be sent"
"""No message can hold the frame's content, such as a pose that is no rotation."""
NOT_PLAYED = (UNREADABLE, UNSENDABLE)
IN_THE_INPUT = "in the input"
"""Follows the reason why a stamp is refused (see `dataflow.order`)."""
BETWEEN_STREAMS = f"between two streams {IN_THE_INPUT}"
"""A frame of a camera's new stream arrived while frames of the old one were still in flight."""
WITHOUT_POSE = "frames without a true pose"
"""Event: a frame has no true pose in an input whose other frames have one. None is recorded, or it is malformed."""
