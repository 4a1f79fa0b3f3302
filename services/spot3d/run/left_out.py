"""Why a run found nothing, or almost nothing: one line for people."""

from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from spot3d.frame_segments import KEYFRAME_REASONS
from spot3d.fusion.objects.reasons import GONE, MOSTLY_BACKGROUND, TOO_COLD, TOO_LARGE, TOO_SELDOM, TOO_SMALL, TOO_THIN
from spot3d.fusion.settings import FusionSettings
from spot3d.fusion.worlds import Verdict
from spot3d.pose.estimate import GIVEN_OTHERWISE
from spot3d.run.results import RunResult
from spot3d.settings import Settings
from spot3d.source.errors import SourceError
from spot3d.source.recording import Recording
from spot3d.source.selected import Selected
from spot3d.source.sequence import FrameSequence

_FEW = 4
"""People are told why if fewer than one in four candidates is an object. It is one in three on redkitchen, whose
shelves and walls are candidates too, and four in five or more on a cabinet and in built-in scenes, cluttered or not."""
_VIEWS_DISAGREE = (TOO_SELDOM, MOSTLY_BACKGROUND, GONE)
"""Why candidates are no objects where poses do not put one thing at one place."""
_FAR_OFF: tuple[Verdict, ...] = ("implausible pose", "pose too far from the origin")
"""Why frames are not fused whose poses have too large a unit."""
_NEAR_M, _FAR_M = 0.4, 4.0
"""The range in which depth cameras measure well."""


def why_so_few(result: RunResult, keyframes: int, settings: Settings) -> str:
    """Why there are no objects, or few of many candidates, and what to do; empty if all is well.

    Candidates seen too seldom are mostly fragments of one view, and count only if nothing was found. Parts of single
    keyframes count only if there were no other candidates. keyframes: how many were looked at.
    """
    if not result.frame_count:
        return ""  # the reason is reported with the frames
    found = len(result.objects)
    parts = {name: result.left_out[name] for name in KEYFRAME_REASONS if name in result.left_out}
    others = {name: count for name, count in result.left_out.items() if count and name not in parts}
    reasons = {name: count for name, count in others.items() if name != TOO_SELDOM or not found}
    candidates = found + sum(reasons.values())
    if _FEW * found >= candidates and found:
        return ""
    if not reasons:
        counts = ", ".join(f"{count} {name.removesuffix(' in a keyframe')}" for name, count in parts.items())
        left_out = f"; left out of keyframes: {counts}" if counts else ""
        return f"no objects: {_without_candidates(keyframes, settings)}{left_out}"
    ordered = sorted(reasons, key=lambda name: (name == TOO_SELDOM, -reasons[name], name))
    words = _words(settings.fusion)
    said = [f"{reasons[name]} {words.get(name, name)}" for name in ordered]
    first = reasons[ordered[0]]
    things = "" if found else "candidate " if first == 1 else "candidates "
    said[0] = f"{first} {things}{'was' if first == 1 else 'were'} {words.get(ordered[0], ordered[0])}"
    head = f"only {found} of {candidates} candidates {'is an object' if found == 1 else 'are objects'}"
    advice = _ADVICE.get(ordered[0])
    if settings.fusion.clustering == "density" and ordered[0] == TOO_SMALL:
        advice = "if these are objects, lower fusion.volume_min"
    return f"{head if found else 'no objects'}: {', '.join(said)}" + (f"; {advice}" if advice else "")


def pose_doubt(result: RunResult, fused: int, skipped: Mapping[str, int], jumps: int = 0) -> str:
    """What given poses have to be, where they hardly can be that; empty if there is no sign of it.

    fused: number of frames. skipped: number of the others, by reason. jumps: how often the poses left the map that
    corrects them; poses shaken by 3 cm and 1.2 degrees never do.
    """
    nothing_agrees = not result.objects and any(result.left_out.get(reason) for reason in _VIEWS_DISAGREE)
    if not (jumps or nothing_agrees) and sum(skipped.get(reason, 0) for reason in _FAR_OFF) <= fused:
        return ""
    times = "once" if jumps == 1 else f"{jumps} times"
    jumped = f"the given poses jumped {times} away from what depth shows, and objects may be found twice: "
    return f"{jumped if jumps else ''}{GIVEN_OTHERWISE} Compare with --pose kiss, which does not use them"


def first_depth(sequence: FrameSequence, found: bool = False) -> str:
    """The median depth of a folder's first frame, in words, which shows a wrong unit; empty if it has no depth.

    found: there are objects: only depth that hardly any camera measures is told then. Other inputs have a unit of their
    own: empty for them, too.
    """
    recording = sequence.original if isinstance(sequence, Selected) else sequence
    if not isinstance(recording, Recording):
        return ""
    with suppress(SourceError, IndexError):
        frame = sequence[0]
        metres = frame.depth_metres()
        measured = metres[metres > 0]
        middle = float(np.median(measured)) if measured.size else 0.0
        if measured.size and not (found and _NEAR_M <= middle <= _FAR_M):
            unit = "metres" if frame.depth_scale == 1 else f"units of {1000 * frame.depth_scale:g} mm"
            return (
                f"the median depth of the first frame is {middle:.2f} m, read as {unit}; if that is "
                "wrong, set the unit of a folder with --depth-unit METRES"
            )
    return ""


def forgotten(keyframes_dropped: int, settings: Settings) -> str:
    """Says that keyframes were forgotten, and how to keep them; empty if none was."""
    if not keyframes_dropped:
        return ""
    one = keyframes_dropped == 1
    first = "keyframe was" if one else f"{keyframes_dropped} keyframes were"
    return (
        f"the first {first} forgotten, with objects that only {'it shows' if one else 'they show'}: fusion keeps "
        f"{settings.fusion.keyframe_limit}; raise fusion.keyframe_limit"
    )


_ADVICE = {
    TOO_LARGE: "if these are objects, raise size_max",
    TOO_COLD: "if these are objects, lower fusion.heat_min and segments.heat_min",
    TOO_SMALL: "if these are objects, move the camera nearer, or lower size_min",
    TOO_THIN: "if these are objects, lower fusion.plane_distance",
    MOSTLY_BACKGROUND: "other views see a table or a wall there: check that the poses fit the depth",
    GONE: "the scene changed, or poses drift",
    TOO_SELDOM: "move the camera slowly around the objects, or record for longer",
}
"""What can be done about the most frequent reason for leaving out candidates."""


def _words(settings: FusionSettings) -> dict[str, str]:
    """The reasons in words, with the limits that apply."""
    volume = f"{1e6 * settings.volume_min:g} cm3"
    return {
        TOO_LARGE: f"longer than {settings.size_max:g} m (eps_max)",
        TOO_COLD: f"colder than {settings.heat_min:g} (eps)",
        TOO_SMALL: f"smaller than {volume}"
        if settings.clustering == "density"
        else f"smaller than {100 * settings.size_min:g} cm (eps_min) or {volume}",
        TOO_THIN: f"thinner than {1000 * settings.plane_distance:g} mm (eps_p)",
        MOSTLY_BACKGROUND: "background in most views",
        GONE: "no longer there",
        TOO_SELDOM: f"seen in fewer than {settings.views_min} keyframes",
    }


def _without_candidates(keyframes: int, settings: Settings) -> str:
    """Why there were no candidates at all."""
    fusion, segments = settings.fusion, settings.segments
    if fusion.clustering == "density":
        return (
            f"nothing on a supporting plane was seen often enough (fusion.frequency_min {fusion.frequency_min}), hot "
            f"(fusion.heat_min {fusion.heat_min:g}) and dense enough (fusion.density_points {fusion.density_points})"
        )
    if not keyframes:
        return (
            "fusion received no segments of keyframes; check that the segments stage is running (while it compiles its "
            "kernels, only once, it is not) and segments.enabled is true"
        )
    return (
        f"no candidates in {keyframes} keyframes: an object must rise {100 * segments.height_min:g} cm above a "
        f"visible surface, be at most {segments.size_max:g} m long, and be within {segments.range_max:g} m of the "
        "camera (segments.height_min, size_max, range_max)"
    )
