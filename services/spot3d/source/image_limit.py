"""Refuses images that no message can hold, before the first is sent."""

from spot3d.camera import Intrinsics
from spot3d.source.errors import SourceError
from spot3d_schemas.limits import MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE


def refuse_large_images(camera: Intrinsics, halved: bool) -> None:
    """Raises SourceError if this camera's frames are larger than a message holds. halved: they are halved already."""
    if _fits(camera):
        return
    remedy = "use --half" if not halved and _fits(camera.halved()) else "scale colour and depth images down"
    raise SourceError(
        f"images of {camera.width} x {camera.height} pixels are too large for a message, which holds "
        f"{MAX_IMAGE_PIXELS} pixels and {MAX_IMAGE_SIDE} a side; {remedy}"
    )


def _fits(camera: Intrinsics) -> bool:
    return camera.width * camera.height <= MAX_IMAGE_PIXELS and max(camera.shape) <= MAX_IMAGE_SIDE
