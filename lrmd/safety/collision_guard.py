"""Collision guard: may the arm go from here along this way? One rule for moves, jogs, plans, ways out and heat.

Rule: on its way no two bodies come nearer to each other than the safety margin or, for an arm that stands within it
already, than the nearest two are at the start. So whatever is requested, in whatever order and how often, the smallest
distance never falls below the margin, or below that of the pose in which the arm was armed.

An obstacle that was told of while the arm stood near it gives room to no other pair, nor does a contact. A contact that
a request permits raises the distance of its own pair, for this request alone
(`lrm_math.collision.contact`). A pair that was brought to touch in this way may not come nearer afterwards than it is,
and gives no other pair any room.

It holds for the rigid arm as commanded and, by itself, for the arm as it sags.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array, Vector3
from lrm_math.collision.scene import Scene
from lrm_math.collision.straight_move import ArmBodies, MotionClearance, check_path, rigid_bodies
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import with_load_at
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.model import Model
from lrmd.safety.contact_force import NO_CONTACTS, ContactRules, permits, permitting
from lrmd.safety.stability import Stability, TipOverViolation, TippingMove

Guard = Callable[[Sequence[Sequence[float]], float, ContactRules], None]
"""Raises an `LrmError` if straight moves through poses (rad, per joint) with a payload (kg) are not safe, contacts
apart that are permitted."""
SAMPLING_STEP = 0.05
"""rad, about 3 degrees: largest joint step between the first sampled poses of the sagging arm."""
SAG_RATE = 1.5
"""Bound on the motion of the sagging arm's bodies as a multiple of the rigid arm's: sag changes by at most half of it.
An assumption, not a proof: a play that is taken up moves them faster."""


NO_EQUILIBRIUM = -1e3
"""m, as separation: a pose in which the loaded arm has no elastic equilibrium."""


class ClearanceViolation(LrmError):
    """An unsafe way: bodies `first` and `second` are at `distance` (m) at `fraction` (0 to 1) of move number `move`."""

    def __init__(
        self, found: MotionClearance, margin: float, move: int, estimated: frozenset[str] = frozenset()
    ) -> None:
        self.move = move
        self.first, self.second = found.first, found.second
        self.distance, self.fraction = found.distance, found.fraction
        within = "" if found.margin >= margin else ", no less than where the arm stands now, within the safety margin"
        guessed = [name for name in (self.first, self.second) if name in estimated]
        note = f" (the shape of {guessed[0]} is an estimate of the arm file)" if guessed else ""
        super().__init__(
            f"{self.first} and {self.second} would come to {self.distance * 1e3:.0f} mm of each other at "
            f"{self.fraction:.0%} of the way; {found.margin * 1e3:.0f} mm must be kept{within}{note}"
        )


@dataclass(frozen=True)
class CollisionGuard:
    """The `Guard` of an arm's collision `scene`; `model` predicts its sag, None for an uncalibrated arm. `touched`:
    pairs that an earlier request was permitted to bring nearer than the margin. `stability`: of the vehicle, None if
    nothing is to be kept of it."""

    scene: Scene
    model: Model | None
    touched: frozenset[frozenset[str]] = frozenset()
    stability: Stability | None = None

    def __call__(self, path: Sequence[Sequence[float]], payload: float, contacts: ContactRules = NO_CONTACTS) -> None:
        """Raises `ClearanceViolation` or `TipOverViolation` for a way through poses with a payload (kg) that is not
        allowed, `LrmError`."""
        poses = self.scene.poses(path)
        clearance, move = self.permitting(contacts, poses, payload).check(poses, payload)
        if clearance.free:
            return
        if isinstance(clearance, TippingMove):
            raise TipOverViolation(clearance, move)
        if clearance.distance <= NO_EQUILIBRIUM:
            raise LrmError("the elastic equilibrium does not settle on the way: too much load for the arm")
        raise ClearanceViolation(clearance, self.scene.margin, move, self.scene.estimated)

    def permitting(self, contacts: ContactRules, path: Array, payload: float) -> CollisionGuard:
        """The guard of one request that permits contacts, on a way through poses (K, n) with a payload (kg)."""
        if contacts == NO_CONTACTS:
            return self
        permitted = permits(self.scene, self.model, contacts.permitted, path, payload)
        return replace(self, scene=permitting(self.scene, permitted), touched=contacts.touched)

    def check(self, path: Array, payload: float, keep: float | None = None) -> tuple[MotionClearance, int]:
        """The clearance on straight moves through poses (K, n), and the number of the move, from 0, that it is of.

        The first move that is not free, or the nearest one; of the sagging arm where the rigid one is free. `keep`:
        separation (m) that is required; None: what the rule requires of a way that begins at the first pose. Of a way
        that is free of collision the move on which the vehicle comes too near to tipping over.
        """
        for bodies in self.bodies(payload):
            clearance, move = check_path(bodies, path, self._required(bodies, path[0]) if keep is None else keep)
            if not clearance.free or clearance.distance <= NO_EQUILIBRIUM:
                return replace(clearance, free=False), move
        tipping = None if self.stability is None else self.stability.refused(path, payload)
        return (clearance, move) if tipping is None else tipping

    def _required(self, bodies: ArmBodies, start: Array) -> Array:
        """(pairs,), the separation (m) that the rule requires of a way that begins at a pose (n,)."""
        here = np.minimum(self.scene.margin, bodies.separations(start[None])[0])
        names = self.scene.names.tolist()
        apart = self.touched | {frozenset(names[number]) for number in self.scene.permits}
        alone = [frozenset(pair) in apart or not self.scene.around.isdisjoint(pair) for pair in names]
        common = here[~np.array(alone)].min(initial=self.scene.margin)
        return np.asarray(np.where(alone, here, common), dtype=np.float64)

    def bodies(self, payload: float) -> tuple[ArmBodies, ...]:
        """The bodies of the rigid arm and, with a model, of the arm that sags with a payload (kg)."""
        rigid = rigid_bodies(self.scene)
        if self.model is None:
            return (rigid,)
        return rigid, ArmBodies(self.scene, partial(self._sagging, self.model, payload), SAG_RATE, SAMPLING_STEP)

    def with_load_at(self, centre: Vector3) -> CollisionGuard:
        """The guard of the arm whose load's centre is known (m), see `Arm.with_load_at`. Raises `LrmError`."""
        bending = None if self.model is None else with_load_at(self.model, centre)
        steady = self.stability and replace(self.stability, model=with_load_at(self.stability.model, centre))
        return replace(self, model=bending, stability=steady)

    def settles(self, q: Array, payload: float) -> bool:
        """Whether the arm has an elastic equilibrium in a pose (n,) with a payload (kg)."""
        return all(bodies.separation(q) > NO_EQUILIBRIUM for bodies in self.bodies(payload))

    def overlaps(self, q: Array, payload: float, names: Collection[str]) -> tuple[str, str] | None:
        """The first body and obstacle, of `names`, that overlap in a pose (n,), of the rigid arm or as it sags."""
        for bodies in self.bodies(payload):
            apart = bodies.separations(q[None])[0]
            for pair, distance in zip(self.scene.names.tolist(), apart.tolist(), strict=True):
                if NO_EQUILIBRIUM < distance < 0.0 and not set(names).isdisjoint(pair):
                    first, second = sorted(pair, key=lambda name: name in names)
                    return first, second
        return None

    def separation(self, q: Array, payload: float) -> Array:
        """(N,), the smallest separation (m) in poses (N, n), of the rigid arm or as it sags with a payload (kg)."""
        return np.asarray(np.min([bodies.separations(q).min(axis=1) for bodies in self.bodies(payload)], axis=0))

    def _sagging(self, model: Model, payload: float, q: Array) -> Array:
        """Separations (N, pairs) in poses (N, n)."""
        settled, rows = batch_equilibrium(model, poses_of(q, payload))
        out = np.full((len(q), len(self.scene.radii)), NO_EQUILIBRIUM)
        if len(rows):
            out[rows] = self.scene.separations(frames(model.chain, settled.slots, len(rows)))
        return out


def guard_of(arm: Arm, model: Model | None, stability: Stability | None = None) -> Guard | None:
    """The guard of an arm, or None if its file has no collision shapes."""
    return CollisionGuard(Scene.of(arm), model, stability=stability) if arm.shapes.capsules else None
