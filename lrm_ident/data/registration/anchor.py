"""Fixed end of measured distances, from the arm as drawn (trilateration).

Differences of squared distances are linear in the point; Gauss-Newton steps then weigh all distances alike
(Navidi, Murphy & Hereman 1998).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.source import Source
from lrm_math.arrays import Array
from lrm_math.effects.tracker_errors import Anchor
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

STEPS = 20
FEWEST = 4
MAX_RELATIVE_ERROR = 0.5
"""Share of the distances' spread that the arm as drawn may miss them by, with the best point."""


def with_anchor(model: Model, poses: Poses, distance: Array, source: Source) -> Model:
    """The model, knowing where distances (N,), m, start; as it is if it says so.

    Else the point is that from which the model's own TCPs are as far as was measured, and its coordinates are free
    parameters. Raises `FileError`: too few distances, or of another arm.
    """
    anchors = [effect for effect in model.effects if isinstance(effect, Anchor)]
    anchor = anchors[0] if anchors else Anchor(model.arm, *Anchor.places(model.arm))
    keys = anchor.keys
    values = {key: model.value(key) for key in model.keys}
    if any(values.get(key) for key in keys):
        return model
    rows = np.flatnonzero(~np.isnan(distance))
    if len(rows) < FEWEST:
        what = f"{len(rows)} distances from a point that is not stated"
        raise source.fault(what, "state distance_from_mm in the file beside the data, or measure more")
    point, residual = trilaterate(solve_equilibrium(model, poses.take(rows)).true_tcp, distance[rows])
    spread = float(distance[rows].std())
    if residual > MAX_RELATIVE_ERROR * spread:
        what = f"from no point would {model.arm.name} miss the distances by less than {residual * 1e3:.3g} mm RMS"
        raise source.fault(what, "are the unit of distance_mm and the joints right, and is it this arm?")
    values |= dict(zip(keys, point.tolist(), strict=True))
    effects = model.effects if anchors else (*model.effects, anchor)
    free = (*model.free, *(key for key in keys if key not in model.free))
    return replace(model_of(model.arm, effects, values), free=free if model.free else ())


def trilaterate(tcp: Array, distance: Array) -> tuple[Array, float]:
    """The point (3,) from which positions `tcp` (N, 3) are at distances (N,), and the RMS of what is left (all m)."""
    centre = tcp.mean(axis=0)
    at = tcp - centre
    columns = np.column_stack([-2.0 * at, np.ones(len(at))])
    point = np.linalg.lstsq(columns, distance**2 - (at**2).sum(axis=1), rcond=1e-9)[0][:3]
    for _ in range(STEPS):
        line = at - point
        length = np.maximum(np.linalg.norm(line, axis=1), 1e-9)
        step = np.linalg.lstsq(-line / length[:, None], distance - length, rcond=1e-9)[0]
        point = point + step
    residual = distance - np.linalg.norm(at - point, axis=1)
    return point + centre, float(np.sqrt((residual**2).mean()))
