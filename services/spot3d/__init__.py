"""spot3d: 3D boxes around unknown objects from a live RGB-D camera (Pahwa et al.'s online method)."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spot3d.boxes import Box3D as Box3D
    from spot3d.camera import Intrinsics as Intrinsics
    from spot3d.camera_pose import CameraPose as CameraPose
    from spot3d.found_object import FoundObject as FoundObject
    from spot3d.frame import RgbdFrame as RgbdFrame
    from spot3d.fusion.fusion import Fusion as Fusion
    from spot3d.fusion.settings import FusionSettings as FusionSettings
    from spot3d.heatmap.heat import weighted_heat as weighted_heat
    from spot3d.heatmap.settings import HeatmapSettings as HeatmapSettings
    from spot3d.pipeline import run_pipeline as run_pipeline
    from spot3d.proposals.propose import propose as propose
    from spot3d.proposals.settings import ProposalSettings as ProposalSettings
    from spot3d.segments.finder import find_segments as find_segments
    from spot3d.segments.settings import SegmentsSettings as SegmentsSettings
    from spot3d.settings import load_settings as load_settings
    from spot3d.source.sequences import open_source as open_source

__version__ = "0.1.0"

# Imported on first access: a stage imports this package too, and has only its own packages installed.
_PLACES = {
    "Box3D": "boxes",
    "CameraPose": "camera_pose",
    "FoundObject": "found_object",
    "Fusion": "fusion.fusion",
    "FusionSettings": "fusion.settings",
    "HeatmapSettings": "heatmap.settings",
    "Intrinsics": "camera",
    "ProposalSettings": "proposals.settings",
    "RgbdFrame": "frame",
    "SegmentsSettings": "segments.settings",
    "find_segments": "segments.finder",
    "load_settings": "settings",
    "open_source": "source.sequences",
    "propose": "proposals.propose",
    "run_pipeline": "pipeline",
    "weighted_heat": "heatmap.heat",
}

__all__ = list(_PLACES)


def __getattr__(name: str) -> object:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
    except ModuleNotFoundError as error:
        from spot3d.missing_package import in_words

        raise ModuleNotFoundError(in_words(error), name=error.name) from error
