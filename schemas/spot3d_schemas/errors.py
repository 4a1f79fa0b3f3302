"""The contract's one exception."""


class CodecError(ValueError):
    """Bytes that are no valid message, or a message that cannot be sent; says schema, field and remedy."""
