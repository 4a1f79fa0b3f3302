"""The source stage's one error, and why frames of an input are not played."""


class SourceError(Exception):
    """The input cannot be played; the message says what is wrong and what to do about it."""


UNREADABLE = "cannot be read"
"""Its files are missing or broken."""
UNSENDABLE = "cannot be sent"
"""No message holds what is in them, such as a pose that is no rotation."""
NOT_PLAYED = (UNREADABLE, UNSENDABLE)
IN_THE_INPUT = "in the input"
"""Said of what is wrong with its stamp (see `dataflow.order`)."""
BETWEEN_STREAMS = f"between two streams {IN_THE_INPUT}"
"""Came of a camera that begins anew while the frames from before were still under way."""
WITHOUT_POSE = "frames without a true pose"
"""The event of a frame that has none in an input whose others have: none is recorded, or it is malformed."""
