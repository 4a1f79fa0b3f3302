"""The wire contract of spot3d: messages, codec, limits and the one table of topics."""

from spot3d_schemas.codec import (
    CodecError,
    WireHeader,
    decode,
    encode,
    encoding,
    peek_header,
    refuse_encoding,
    refuse_length,
)
from spot3d_schemas.image_messages import CameraIntrinsics, DepthNoise, Frame, Heat, Preview, Proposals, Segments
from spot3d_schemas.json_schema import json_schema
from spot3d_schemas.message import Header, Hop, Message
from spot3d_schemas.names import checked_name
from spot3d_schemas.state_messages import About, End, Health, Progress
from spot3d_schemas.topics import (
    BRIDGE,
    MESSAGES,
    STAGES,
    TOPICS,
    Token,
    Topic,
    alive_key,
    fleet_key,
    key,
    process_key,
    robot_of,
    token_of,
)
from spot3d_schemas.world_messages import MapChanges, MapPoints, Object3D, Objects, Pose

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
    "Token",
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
    "refuse_length",
    "robot_of",
    "token_of",
]
