"""The answer to `fusion/changes`."""

import numpy as np
import zenoh

from spot3d.fusion.fusion import Fusion
from spot3d.fusion.map.map_arrays import R, X
from spot3d.fusion.map.selection import counting
from spot3d_schemas import Header, MapChanges
from spot3d_schemas.limits import MAX_COUNT, MAX_MAP_CHANGES


def changes_message(fusion: Fusion, parameters: zenoh.Parameters, header: Header, epoch: str) -> MapChanges:
    """What changed in the map after what the client has, as the query's parameters say (see `MapChanges`).

    Missing or non-numeric parameters count as a client that has nothing. One that claims more than there is has all.
    """
    generation, since = _number(parameters, "generation", 0), _number(parameters, "since", 0)
    limit = max(1, min(_number(parameters, "limit", MAX_MAP_CHANGES), MAX_MAP_CHANGES))
    changes, heatmap = fusion.map_changes, fusion.heatmap
    rows = heatmap.points()
    least, tau = counting(fusion.frame_count, fusion.settings)
    known = since if generation == changes.generation else 0
    chosen, cursor, behind = changes.after(known, limit, rows, least, tau)
    heat, frequency = changes.as_sent(chosen)
    points = rows[chosen]
    return MapChanges(
        header=header,
        generation=changes.generation,
        cursor=cursor,
        behind=behind,
        number=chosen.astype(np.uint32),
        xyz=np.ascontiguousarray(points[:, X : X + 3]),
        rgb=np.clip(np.rint(points[:, R : R + 3]), 0, 255).astype(np.uint8),
        heat=heat,
        frequency=frequency,
        planes=fusion.supports.planes(),
        total=heatmap.count,
        epoch=epoch,
    )


def _number(parameters: zenoh.Parameters, name: str, otherwise: int) -> int:
    text = parameters.get(name) or ""
    return min(int(text), MAX_COUNT) if text.isdecimal() and len(text) < 20 else otherwise
