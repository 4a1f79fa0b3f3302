"""Settings of the source stage."""

from pydantic import BaseModel, ConfigDict, Field


class SourceSettings(BaseModel):
    """How an input is played."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    rate_hz: float = Field(
        0.0,
        ge=0,
        le=1000,
        description="frames per second to play at; 0: the recorded rate",
    )
    halved: bool = Field(False, description="play frames at half size")
    scene_frames: int = Field(300, ge=1, le=1_000_000, description="length of the built-in scene, frames at 30 Hz")
    scene_seed: int = Field(0, ge=0, le=2**31 - 1, description="which built-in scene, where the name gives no seed")
    scene_cluttered: bool = Field(False, description="built-in scene with 18 to 24 objects instead of 12")
