"""Contacts that a request permits: how deep, from the largest force, by the stiffness of the arm's model.

A tip that is commanded below a surface stays on it: the arm is bent back by the depth, and presses with its stiffness.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lrm_math.arrays import ORIGIN, Array, Vector3
from lrm_math.collision.contact import Contact, ContactPermit
from lrm_math.collision.scene import Scene
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import under_gravity, with_load_at
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model
from lrmd.errors import RequestError

TEST_LOAD = 0.05
"""kg, whose weight at the tip shows how far the arm yields."""
SPACING = 0.1
"""rad: largest joint step between the poses of a way in which the stiffness is computed."""
SHIFT = 1e-5
"""m, by which bodies are shifted to find the normal of a contact."""


@dataclass(frozen=True)
class ContactRules:
    """Contacts `permitted` by a request, and pairs `touched` by earlier ones, which gave no other pair any room."""

    permitted: tuple[Contact, ...] = ()
    touched: frozenset[frozenset[str]] = frozenset()


NO_CONTACTS = ContactRules()


def permitting(scene: Scene, permits: Iterable[ContactPermit]) -> Scene:
    """The scene in which contacts are permitted. Raises `RequestError`: no such shape, or two parts of the arm."""
    try:
        return scene.permitting(permits)
    except LrmError as error:
        raise RequestError("contact", str(error)) from None


def permits(
    scene: Scene, model: Model | None, contacts: Sequence[Contact], path: Array, payload: float
) -> Iterator[ContactPermit]:
    """The permits on a way through poses (K, n) with a payload (kg): no deeper than the force allows, where the arm is
    stiffest. A model that does not bend, or none, allows no depth at all: bodies may touch, and not press."""
    poses = _sampled(path)
    for contact in contacts:
        depth, permit = contact.permit.depth, contact.permit
        if depth > 0.0:
            yielding = 0.0 if model is None else _yielding(scene, model, permit, poses, payload)
            depth = min(depth, contact.force * yielding)
        yield replace(permit, depth=depth)


def _yielding(scene: Scene, model: Model, permit: ContactPermit, q: Array, payload: float) -> float:
    """m/N, how far the tip yields at least in poses (N, n), pushed along the normal of a contact."""
    down = _inward(scene, permit, q)
    if down is None or not any(model.arm.gravity) or not any(body.carries_payload for body in model.arm.bodies):
        return 0.0
    pushed = with_load_at(under_gravity(model, down), ORIGIN)  # the force acts at the tip, wherever the load is
    tips = []
    for load in (payload, payload + TEST_LOAD):
        settled, rows = batch_equilibrium(pushed, poses_of(q, load))
        if len(rows) < len(q):
            return 0.0
        tips.append(settled.true_tcp)
    force = TEST_LOAD * float(np.linalg.norm(model.arm.gravity))
    return max(0.0, float(((tips[1] - tips[0]) @ np.array(down)).min()) / force)


def _inward(scene: Scene, permit: ContactPermit, q: Array) -> Vector3 | None:
    """Unit vector from the first body into the second where they are nearest on the way; None for no such pair."""
    pair = next((k for k, names in enumerate(scene.names.tolist()) if frozenset(names) == permit.pair), None)
    if pair is None:
        return None
    placed = scene.frames(q)
    nearest = placed[int(scene.separations(placed)[:, pair].argmin())]
    moved = np.repeat(nearest[None], 6, axis=0)
    for axis in range(3):
        moved[axis, :, axis, 3] += SHIFT
        moved[3 + axis, :, axis, 3] -= SHIFT
    at = scene.separations(moved)[:, pair]
    slope = at[3:] - at[:3]
    size = float(np.linalg.norm(slope))
    if size == 0.0:
        return None
    x, y, z = (slope / size).tolist()
    return x, y, z


def _sampled(path: Array) -> Array:
    """The poses of a way (K, n), and others between them."""
    parts = [path[:1]]
    for start, end in pairwise(path):
        count = int(np.ceil(np.abs(end - start).max(initial=0.0) / SPACING)) or 1
        parts.append(start + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - start))
    return np.concatenate(parts)
