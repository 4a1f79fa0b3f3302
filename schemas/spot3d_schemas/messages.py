"""All messages of the dataflow."""

from spot3d_schemas.image_messages import Frame, Heat, Preview, Proposals, Segments
from spot3d_schemas.message import Message
from spot3d_schemas.state_messages import About, End, Health, Progress
from spot3d_schemas.world_messages import MapChanges, MapPoints, Objects, Pose

MESSAGES: dict[str, type[Message]] = {
    message.__name__: message
    for message in (
        Frame,
        Preview,
        End,
        Pose,
        Proposals,
        Heat,
        Segments,
        Objects,
        MapPoints,
        MapChanges,
        Progress,
        Health,
        About,
    )
}
"""Every message by its short name."""
