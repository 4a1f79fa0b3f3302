"""The pose provider that the settings name."""

from spot3d.pose.correction import CorrectedPoses
from spot3d.pose.estimate import PoseTracker
from spot3d.pose.given import GivenPoses
from spot3d.pose.settings import PoseSettings
from spot3d.pose.tracking import MapTracker


def make_tracker(settings: PoseSettings) -> PoseTracker:
    """A fresh tracker of `settings.provider`.

    Raises ModuleNotFoundError, which names the extra to install, where the provider's package is absent.
    """
    if settings.provider == "given":
        return CorrectedPoses(settings) if settings.given_sigma > 0 else GivenPoses()
    if settings.provider == "gicp":
        from spot3d.pose.gicp import SmallGicp

        return MapTracker(SmallGicp(settings.surfel_limit), settings)
    from spot3d.pose.kiss import KissIcp

    return MapTracker(KissIcp(settings.surfel_limit), settings)
