"""The wire contract of spot3d: messages, codec, limits and the one table of topics."""

from spot3d_schemas.codec import WireHeader, decode, encode, encoding, peek_header, refuse_encoding
from spot3d_schemas.errors import CodecError
from spot3d_schemas.header import Header, Hop
from spot3d_schemas.json_schema import json_schema
from spot3d_schemas.messages import (
    MESSAGES,
    About,
    CameraIntrinsics,
    DepthNoise,
    End,
    Frame,
    Health,
    Heat,
    MapChanges,
    MapPoints,
    Message,
    Object3D,
    Objects,
    Pose,
    Preview,
    Progress,
    Proposals,
    Segments,
)
from spot3d_schemas.names import checked_name
from spot3d_schemas.topics import BRIDGE, STAGES, TOPICS, Topic, alive_key, fleet_key, key, process_key

__all__ = [
    "BRIDGE",
    "MESSAGES",
    "STAGES",
    "TOPICS",
    "About",
    "CameraIntrinsics",
    "CodecError",
    "DepthNoise",
    "End",
    "Frame",
    "Header",
    "Health",
    "Heat",
    "Hop",
    "MapChanges",
    "MapPoints",
    "Message",
    "Object3D",
    "Objects",
    "Pose",
    "Preview",
    "Progress",
    "Proposals",
    "Segments",
    "Topic",
    "WireHeader",
    "alive_key",
    "checked_name",
    "decode",
    "encode",
    "encoding",
    "fleet_key",
    "json_schema",
    "key",
    "peek_header",
    "process_key",
    "refuse_encoding",
]
