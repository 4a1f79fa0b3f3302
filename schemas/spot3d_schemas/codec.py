"""Messages to bytes and back: one msgpack map, arrays inside it as {dtype, shape, encoding, data}."""

import re
from functools import cache, lru_cache
from typing import Any, TypeVar

import msgpack
from numpy.typing import NDArray
from pydantic import ValidationError

from spot3d_schemas.arrays import ArraySpec, decode_array, dtype_name, encode_data
from spot3d_schemas.limits import MAX_FIELD_BYTES, MAX_FIELDS, MAX_MESSAGE_BYTES, MAX_OBJECTS_VALUES
from spot3d_schemas.message import Header, Message
from spot3d_schemas.wire import Span, bin_data, bin_header, map_spans, unpack

_ALIGNMENT = 16
"""Raw arrays begin at a multiple of this, so that decoded views are aligned for every dtype."""

_DATA_KEY = msgpack.packb("data")
_VERSION = re.compile(r"(\d{1,4})\.(\d{1,4})", re.ASCII)

M = TypeVar("M", bound=Message)


class CodecError(ValueError):
    """Bytes that are no valid message, or a message that cannot be sent; says schema, field and remedy."""


class WireHeader(Header):
    """A header as it is on the wire, with its message's schema (`spot3d.Frame`) and version (`1.0`)."""

    schema_name: str
    version: str


def encode(message: Message, *, thin_link: bool = False, jpeg_quality: int = 90) -> bytes:
    """The message's bytes.

    thin_link: depth and heat in a lossless code, colour as JPEG of `jpeg_quality` (needs OpenCV); else raw.
    Raises CodecError where the message is longer than the limit or an array cannot be coded.
    """
    specs = array_fields(type(message))
    fields = message.model_dump(exclude=set(specs))
    fields["header"] = {"schema": message.SCHEMA, "version": message.VERSION, **fields["header"]}
    packer = msgpack.Packer()
    head = [packer.pack_map_header(len(fields) + len(specs))]
    for name, value in fields.items():
        try:
            head += (packer.pack(name), packer.pack(value))
        except UnicodeEncodeError as error:
            raise CodecError(f"{message.SCHEMA}.{name}: cannot be encoded as UTF-8: {error}") from None
    pieces: list[bytes | memoryview] = [b"".join(head)]
    at = len(pieces[0])
    for name, spec in specs.items():
        try:
            array = _array_pieces(name, getattr(message, name), spec.thin if thin_link else (), jpeg_quality, at)
        except ValueError as error:
            raise CodecError(f"{message.SCHEMA}.{name}: {error}") from None
        pieces += array
        at += sum(map(len, array))
    refuse_length(at, message.SCHEMA)
    return b"".join(pieces)


def decode(payload: bytes | bytearray | memoryview, message: type[M]) -> M:
    """The message in `payload`. Arrays are read-only views into it, which keep it alive.

    Raises CodecError, and nothing else, for whatever is no valid `message` of the same major version.
    """
    view = memoryview(payload).cast("B")
    schema = message.SCHEMA
    spans = _field_spans(view, message.MAX_VALUES, schema)
    header = _header(view, spans, schema)
    _check_schema(header, message)
    fields: dict[str, Any] = {"header": header}
    specs = array_fields(message)
    for name in message.model_fields:
        if name == "header" or name not in spans:
            continue
        try:
            if name in specs:
                fields[name] = _read_array(view, spans[name], specs[name])
            else:
                fields[name] = unpack(view, spans[name], message.MAX_FIELD_BYTES)
        except ValueError as error:
            raise CodecError(f"{schema}.{name}: {error}") from None
    try:
        return message.model_validate(fields)
    except ValidationError as error:
        raise CodecError(first_problem(schema, error)) from None


def peek_header(payload: bytes | bytearray | memoryview) -> WireHeader:
    """The header of any message of any version, without looking at its other fields. Raises CodecError."""
    view = memoryview(payload).cast("B")
    header = _header(view, _field_spans(view, MAX_OBJECTS_VALUES, "message"), "message")
    try:
        return WireHeader.model_validate({**header, "schema_name": header.get("schema")})
    except ValidationError as error:
        raise CodecError(first_problem("header", error)) from None


def encoding(message: type[Message]) -> str:
    """The Zenoh encoding of a message: `application/msgpack;schema=spot3d.Frame/1`."""
    return f"application/msgpack;schema={message.SCHEMA}/{message.VERSION.partition('.')[0]}"


def refuse_encoding(stated: str, message: type[Message]) -> None:
    """Raises CodecError where a sample's Zenoh encoding is not that of `message` in this major version."""
    expected = encoding(message)
    if stated != expected:
        raise CodecError(
            f"{message.SCHEMA}: the sample's encoding is {stated[:100]!r}, this reader takes {expected!r}; "
            "publish with that encoding, or bring both sides to the same major version"
        )


def refuse_length(length: int, what: str) -> None:
    """Raises CodecError, which begins with `what`, where a message of this many bytes is longer than any may be."""
    if length > MAX_MESSAGE_BYTES:
        raise CodecError(f"{what}: {length} bytes exceed the limit of {MAX_MESSAGE_BYTES} for a message; send less")


@cache
def array_fields(message: type[Message]) -> dict[str, ArraySpec]:
    """The array fields of a message class and what each may hold."""
    return {
        name: spec
        for name, field in message.model_fields.items()
        for spec in field.metadata
        if isinstance(spec, ArraySpec)
    }


def first_problem(schema: str, error: ValidationError) -> str:
    """The first thing that pydantic found wrong, as one line that names the field."""
    problem = error.errors(include_url=False, include_context=False)[0]
    path = ".".join((schema, *map(str, problem["loc"])))
    text = problem["msg"].removeprefix("Value error, ")
    given = problem["input"]
    got = f" (got {given!r:.60})" if isinstance(given, int | float | str | None) else ""
    more = f"; and {error.error_count() - 1} more" if error.error_count() > 1 else ""
    return f"{path}: {text[0].lower()}{text[1:]}{got}{more}"


def _array_pieces(
    name: str, array: NDArray[Any], codes: tuple[str, ...], jpeg_quality: int, at: int
) -> list[bytes | memoryview]:
    """Key and value of an array field that begins at byte `at`; a raw array's bytes are not copied here."""
    code, data = encode_data(array, codes, jpeg_quality)
    described = _described(name, dtype_name(array), array.shape, code)
    before_data = _DATA_KEY + bin_header(len(data))
    padding = -(at + len(described) + 1 + len(before_data)) % _ALIGNMENT
    return [b"".join((described, bytes((padding,)), bytes(padding), before_data)), data]


@lru_cache(maxsize=100)
def _described(name: str, dtype: str, shape: tuple[int, ...], code: str) -> bytes:
    """The bytes of an array field up to the length of its padding; those of a camera's images repeat."""
    pack = msgpack.packb
    values = ("dtype", dtype, "shape", list(shape), "encoding", code)
    # Readers skip `pad` as they skip any field that they do not know.
    return b"".join((pack(name), b"\x85", *map(pack, values), pack("pad"), b"\xc4"))


def _field_spans(view: memoryview, max_values: int, schema: str) -> dict[str, Span]:
    refuse_length(len(view), schema)
    try:
        return map_spans(view, (0, len(view)), MAX_FIELDS, max_values)
    except ValueError as error:
        raise CodecError(f"{schema}: {error}") from None


def _header(view: memoryview, spans: dict[str, Span], schema: str) -> dict[str, Any]:
    if "header" not in spans:
        raise CodecError(f"{schema}.header: is missing; every message must have one")
    try:
        header = unpack(view, spans["header"], MAX_FIELD_BYTES)
    except ValueError as error:
        raise CodecError(f"{schema}.header: {error}") from None
    if not isinstance(header, dict):
        raise CodecError(f"{schema}.header: is {type(header).__name__}; expected a map")
    return header


def _check_schema(header: dict[str, Any], message: type[Message]) -> None:
    schema = message.SCHEMA
    if header.get("schema") != schema:
        raise CodecError(
            f"{schema}.header.schema: is {str(header.get('schema'))[:60]!r}; expected {schema!r}: "
            "is the subscription to the right topic?"
        )
    stated = header.get("version")
    parts = _VERSION.fullmatch(stated) if isinstance(stated, str) else None
    if parts is None:
        raise CodecError(
            f"{schema}.header.version: is {str(stated)[:60]!r}; expected a version such as {message.VERSION!r}"
        )
    major = message.VERSION.partition(".")[0]
    if int(parts[1]) != int(major):
        raise CodecError(
            f"{schema}.header.version: the message has version {stated}, this reader understands {major}.x "
            f"(its own is {message.VERSION}); bring sender and receiver to the same major version"
        )


def _read_array(view: memoryview, span: Span, spec: ArraySpec) -> NDArray[Any]:
    places = map_spans(view, span, MAX_FIELDS, MAX_FIELDS)
    missing = [name for name in ("dtype", "shape", "encoding", "data") if name not in places]
    if missing:
        raise ValueError(f"the array lacks {', '.join(missing)}")
    described = {name: unpack(view, places[name], MAX_FIELD_BYTES) for name in ("dtype", "shape", "encoding")}
    return decode_array(described, bin_data(view, places["data"]), spec)
