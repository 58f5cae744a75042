"""Ways round obstacles for the bent arm: planned for the rigid one, checked for the one that sags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lrm_math.chain import Array
from lrm_math.collision import Scene, clearance_of
from lrm_math.equilibrium import equilibrium
from lrm_math.model import Model
from lrm_math.plan import NoPath, Path, plan, stream
from lrm_math.poses import poses_of
from lrm_math.walk import frames
from lrmd.config import Config

SAMPLES = 40
"""Random poses of one attempt: most ways take fewer; a new attempt begins with new trees."""
MORE_MARGIN = 0.01
"""m: how much more distance is kept after an attempt whose way is too narrow for the sagging arm."""
SAME = 1e-6
"""Share of a move: corners that are no further apart than this are one."""
LOOK_EVERY = 0.05
"""rad: how densely the sagging arm is looked at."""


@dataclass(frozen=True)
class Way:
    """Waypoints (rad) from the start to the end."""

    waypoints: tuple[tuple[float, ...], ...]
    samples: int


def find_way(
    config: Config,
    scene: Scene,
    model: Model,
    ends: tuple[Sequence[float], Sequence[float]],
    payload: float,
    seed: int,
    goes_on: Callable[[], None],
) -> Way | str:
    """A way between two poses (rad), or why there is none. Tries until `goes_on` raises."""
    rng = np.random.default_rng(seed)
    margin = scene.margin
    while True:
        goes_on()
        found = plan(scene, *ends, rng, margin=margin, samples=SAMPLES)
        if isinstance(found, NoPath):
            if found.why != "not found":
                return str(found)
            continue
        if _keeps_clear(scene, model, found, payload):
            return Way(_with_corners(config, found.waypoints), found.samples)
        if margin > scene.margin + 0.05:
            return f"the rigid arm gets there, but the arm as it sags comes closer than {scene.margin * 1e3:.0f} mm"
        margin += MORE_MARGIN


def _keeps_clear(scene: Scene, model: Model, path: Path, payload: float) -> bool:
    q = stream(path, LOOK_EVERY)
    rest = equilibrium(model, poses_of(q, payload))
    return bool(clearance_of(scene, frames(model.chain, rest.slots, len(q))).distance.min() >= scene.margin)


def _with_corners(config: Config, way: Array) -> tuple[tuple[float, ...], ...]:
    """The way with a waypoint wherever a joint passes a point of its level-1 table."""
    out = [tuple(way[0].tolist())]
    for before, after in pairwise(way):
        at = {1.0}
        for servo, a, b in zip(config.servos, before.tolist(), after.tolist(), strict=False):
            at |= {t for knot in servo.table.angle if a != b and SAME < (t := (knot - a) / (b - a)) < 1 - SAME}
        out += [tuple((before + t * (after - before)).tolist()) for t in sorted(at)]
    return tuple(out)
