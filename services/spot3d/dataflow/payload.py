"""The bytes of a message, wherever they lie."""

import zenoh


def intact_bytes(payload: zenoh.ZBytes) -> bytes | None:
    """A copy of the bytes; None where they lay in shared memory that was taken back before the copy was done.

    A sender takes memory back from a reader that shows no sign of life for a tenth of a second, so that a dead
    one keeps nothing. What is still valid after the copy was valid all the while.
    """
    data = payload.to_bytes()
    shared = payload.as_shm()
    return data if shared is None or shared.is_valid() else None
