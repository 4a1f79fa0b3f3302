"""Settings of the source stage."""

from pydantic import BaseModel, ConfigDict, Field, field_validator

from spot3d.depth_noise import parse_noise


class SourceSettings(BaseModel):
    """How an input is played."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    rate_hz: float = Field(0.0, ge=0, le=1000, description="frames per second to play at; 0: the recorded rate")
    halved: bool = Field(False, description="play frames at half their width and height")
    depth_noise: str = Field(
        "",
        description="noise of the depth: kinect-v1, d415, d435, d455, tof, stereo:BASELINE,FOCAL[,SUBPIXEL] or "
        "FLOOR,GROWTH,AT in metres (and pixels); empty: as the input states, otherwise a Kinect v1's",
    )
    depth_unit: float = Field(
        0.0,
        ge=0,
        le=0.01,
        description="unit of the depth images of a folder, metres; 0: the layout's own, 0.001 (7-Scenes) or 0.0002 "
        "(TUM RGB-D)",
    )
    colour_topic: str = Field("", description="ROS bags: topic of the colour images; empty: found by type and name")
    depth_topic: str = Field("", description="ROS bags: topic of the depth images; empty: found by type and name")
    pose_topic: str = Field(
        "",
        description='ROS bags: topic of the camera\'s poses, used by pose.provider = "given": odometry, poses, /tf or '
        "/tf:WORLD",
    )

    @field_validator("depth_noise")
    @classmethod
    def _noise_is_known(cls, text: str) -> str:
        if text:
            parse_noise(text)
        return text
