"""JSON Schema of the messages, for people who write clients in other languages."""

from typing import Any

from spot3d_schemas.codec import encoding
from spot3d_schemas.limits import MAX_MESSAGE_BYTES
from spot3d_schemas.message import Message


def json_schema(message: type[Message]) -> dict[str, Any]:
    """The JSON Schema of a message as it is on the wire, where it is msgpack instead of JSON.

    Arrays are maps {dtype, shape, encoding, data}; `data`, a msgpack bin, is described as a binary string.
    """
    schema = message.model_json_schema()
    header = schema["$defs"]["Header"]
    header["properties"] = {
        "schema": {"const": message.SCHEMA},
        "version": {"type": "string", "pattern": rf"^{message.VERSION.partition('.')[0]}\.\d+$"},
        **header["properties"],
    }
    header["required"] = ["schema", "version", *header["required"]]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:{message.SCHEMA.replace('.', ':')}:{message.VERSION}",
        "$comment": (
            f"The wire form is one msgpack map of these fields, at most {MAX_MESSAGE_BYTES} bytes, published "
            f"with the Zenoh encoding {encoding(message)!r}. Readers ignore fields that are not listed."
        ),
        **schema,
    }
