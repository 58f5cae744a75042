"""Where to put the board, and in which postures to touch it: touches that predict the tip best (Cramér–Rao bound).

The tip's expected error at poses all over the arm's range, up to a rigid motion, since nobody knows where a board
stands: V-optimality (Atkinson & Donev 1992). Each placement's six unknowns are eliminated from its information by their
Schur complement, so that the information of placements adds up. The placements are the best of all combinations, the
postures at these the best by DETMAX.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import cos, degrees, pi, radians, sin

import numpy as np

from lrm_ident.data.measurement_file.known_columns import ANGLE
from lrm_ident.data.measurement_file.pose_quantity import PLACEMENT, POINT
from lrm_ident.data.rigid_motion import homogeneous, shift, skew, turn
from lrm_ident.design.detmax import exchange
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS, nominal_model
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef
from lrm_math.effects.reference import BASE_OFFSETS
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

Points = Mapping[str, Sequence[float]]
"""Places of sockets on their board (mm), by name."""
FLAT = ((0.35, 0.0, 0.0), (0.48, 0.0, 0.0))
RAISED = ((0.46, 0.28, 0.6), (0.52, 0.22, 1.2), (0.52, 0.46, 1.2), (0.59, 0.41, 0.5 * pi))
"""Placements to choose from: distance of the board's middle from the arm's base and its height over the table, in
reaches of the arm, and by how much it leans back, facing the arm (rad)."""
PANS = (-0.9, -0.45, 0.0, 0.45, 0.9)
YAW = 0.3
"""rad: directions of the placements, and by how much a board is turned in its own plane."""
POSTURES, TRIES, STEPS = 12, 30, 25
"""Postures of each socket to choose from, random starts for each, and steps of Gauss–Newton from there."""
WITHIN, LONGEST_STEP, REACHED = 0.95, 0.3, 1e-4
"""Share of the joints' ranges, rad, and m."""
INTO, ABOVE_TABLE, WRIST = cos(radians(55.0)), 0.03, 3
"""Cosine of the largest angle between the tool and a socket's axis; m above the table of the last frames but the tip,
and how many these are."""
REACHABLE, FRESH, PLACE_SD = 0.9, 200, 0.2
"""Share of the sockets' postures without which a placement is none, poses at which the tip is predicted, and m and rad
by which it is known where a board stands."""
RANDOM_DRAWS = 9
LEAST, COUNTS = 5, (20, 24, 36, 60)
"""Touches of a placement, and numbers of touches whose expected error is stated, so that a person can choose."""


@dataclass(frozen=True)
class BoardPlacement:
    """A placement of the board.

    `distance`, `height`: of its middle from the arm's base (m). `pan`: its direction from there (rad). `lean`: by how
    much it leans back, facing the arm (rad): 0 lies flat, pi/2 stands upright.
    """

    distance: float
    height: float
    lean: float
    pan: float

    def motion(self, points: Points) -> Array:
        """(4, 4), of the frame of a board with these sockets in the arm's."""
        R = (turn((0, 0, 1), self.pan) @ turn((0, 1, 0), -self.lean) @ turn((0, 0, 1), YAW))[:3, :3]
        middle = [self.distance * cos(self.pan), self.distance * sin(self.pan), self.height]
        places = np.array([*points.values()])[:, :2] * MM
        half = [*(0.5 * (places.min(axis=0) + places.max(axis=0))), 0.0]
        return shift(middle) @ homogeneous(R, -R @ half)

    @property
    def words(self) -> str:
        """For a person who puts it there."""
        side = "straight ahead" if abs(self.pan) < 0.01 else f"{degrees(self.pan):+.0f} deg to the side"
        lies = "flat on the table" if self.lean == 0.0 else f"leaning back {degrees(self.lean):.0f} deg, facing the arm"
        return f"{lies}, middle {self.distance / MM:.0f} mm from the base and {self.height / MM:.0f} mm high, {side}"


@dataclass(frozen=True, eq=False)
class TouchPlan:
    """Touches to make, placement by placement.

    Attributes:
        placements: where the board stands. q: (N, n), rad, with which the arm as drawn is in the socket.
        points: (N,), names of the sockets. placement: (N,), numbers from 1.
        tip_error, random_tip_error: RMS distance (m) of the tip from where it will be predicted, as far as the noise
            goes; the second with as many random postures at the same placements.
        tracker_error: the same by a tracker of this noise at the same poses, which has one frame for all of them.
        error_of: tip_error by number of touches, this one and others planned at the same placements.
    """

    placements: tuple[BoardPlacement, ...]
    q: Array
    points: tuple[str, ...]
    placement: tuple[int, ...]
    tip_error: float
    random_tip_error: float
    tracker_error: float
    error_of: Mapping[int, float]

    def csv(self) -> str:
        """As a file of touches to make, angles in deg."""
        joints = self.q.shape[1]
        header = ["pose", *(ANGLE.format(k) for k in range(1, joints + 1)), POINT, PLACEMENT]
        angles = np.degrees(self.q).round(3).tolist()
        rows = zip(range(1, len(angles) + 1), angles, self.points, self.placement, strict=True)
        lines = (",".join(map(str, (number, *q, point, place))) for number, q, point, place in rows)
        return "\n".join([",".join(header), *lines]) + "\n"


@dataclass(frozen=True, eq=False)
class _Touches:
    """Touches that are possible at one placement: q (N, n), rad, socket (N,), and their columns (N, 3, P + 6), m."""

    placement: BoardPlacement
    q: Array
    points: tuple[str, ...]
    columns: Array


def plan_touches(
    arm: Arm,
    points: Points,
    count: int,
    placements: int,
    noise: float,
    seed: int = 0,
    progress: OnProgress = silent,
) -> TouchPlan:
    """The touches that predict the tip best.

    Args:
        points: the sockets. noise: m per axis, of a touch.

    Raises `LrmError`: too few of them, or an arm that reaches the board at too few placements.
    """
    if count < LEAST * placements:
        raise LrmError(f"{count} touches at {placements} placements; should be {LEAST * placements} or more")
    problem = _Problem.of(arm, noise, seed)
    possible = []
    every = [*product(FLAT + RAISED, PANS)]
    for done, ((distance, height, lean), pan) in enumerate(every):
        progress(done, len(every))
        far, table = reach(arm), arm.table or 0.0
        placement = BoardPlacement(distance * far, table + height * far, lean, pan)
        if (touches := problem.touches(points, placement)) is not None:
            possible.append(touches)
    if len(possible) < placements:
        what = f"the arm reaches all sockets at {len(possible)} of {len(every)} placements that were tried"
        raise LrmError(f"{what}, not at {placements}; make a smaller board (sockets board --length-mm, --width-mm)")
    of_each = [problem.reduced(touches) * (count / placements) for touches in possible]
    best = min(
        combinations(range(len(possible)), placements),
        key=lambda chosen: problem.error(sum(of_each[k] for k in chosen)),
    )
    return problem.plan([possible[k] for k in best], count)


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is to be identified: the default effects of an arm as drawn, and what that is worth to the predicted tip.

    `prior`: (P, P), 1/variances. `worth`: (P, P), of which the trace with the parameters' covariance is the tip's mean
    squared error (m²).
    """

    arm: Arm
    keys: tuple[str, ...]
    prior: Array
    worth: Array
    noise: float
    rng: np.random.Generator

    @classmethod
    def of(cls, arm: Arm, noise: float, seed: int) -> _Problem:
        """The problem of an arm touched with a noise (m); its fresh poses are drawn with the seed."""
        model, rng = nominal_model(arm, DEFAULT_EFFECTS), np.random.default_rng(seed)
        keys = tuple(key for key in model.keys if ParameterRef.parse(key).effect != BASE_OFFSETS)
        free = model.with_free(keys)
        prior_information = typical_prior(free)
        sd = dict(zip(prior_information.keys, np.sqrt(np.diag(prior_information.covariance)), strict=True))
        prior = np.diag([sd.get(key, np.inf) ** -2.0 for key in keys])
        low, high = (0.8 * np.array([getattr(joint, end) for joint in arm.joints]) for end in ("lower", "upper"))
        settled = solve_equilibrium(free, poses_of(rng.uniform(low, high, (FRESH, arm.dof))))
        F = parameter_jacobian(settled, keys).reshape(3 * FRESH, -1)
        Q, _ = np.linalg.qr(_rigid(settled.tcp).reshape(3 * FRESH, 6))
        F = F - Q @ (Q.T @ F)
        return cls(arm, keys, prior, F.T @ F / FRESH, noise, rng)

    def touches(self, points: Points, placement: BoardPlacement) -> _Touches | None:
        """Those that are possible at a placement; None if some socket is out of reach there."""
        T, names = placement.motion(points), [name for name in points for _ in range(POSTURES)]
        goals = np.array([(T @ [*np.array(points[name]) * MM, 1.0])[:3] for name in names])
        if np.linalg.norm(goals, axis=1).max() > reach(self.arm) or goals[:, 2].min() < (self.arm.table or 0.0) - MM:
            return None
        q = postures(self.arm, goals, T[:3, 2], self.rng)
        is_reached = ~np.isnan(q[:, 0])
        reached = tuple(name for name, there in zip(names, is_reached, strict=True) if there)
        if is_reached.mean() < REACHABLE or {*reached} != {*points}:
            return None
        settled = solve_equilibrium(nominal_model(self.arm, DEFAULT_EFFECTS), poses_of(q[is_reached]))
        columns = np.concatenate([parameter_jacobian(settled, self.keys), _rigid(settled.tcp)], axis=2)
        return _Touches(placement, q[is_reached], reached, columns)

    def reduced(self, touches: _Touches) -> Array:
        """(P, P), mean information of a touch (1/m²) on the arm, without what it tells of the placement."""
        P = len(self.keys)
        A = touches.columns.reshape(-1, P + 6) / self.noise
        Q, _ = np.linalg.qr(A[:, P:])
        A = A[:, :P] - Q @ (Q.T @ A[:, :P])
        return np.asarray(A.T @ A / len(touches.q))

    def error(self, information: Array | float) -> float:
        """RMS error of the predicted tip (m)."""
        M = information + self.prior
        size = 1.0 / np.sqrt(np.diag(M))
        covariance = size[:, None] * np.linalg.inv(M * size * size[:, None]) * size
        return float(np.sqrt(np.sum(self.worth * covariance)))

    def plan(self, chosen: Sequence[_Touches], count: int) -> TouchPlan:
        """The best touches at some placements."""
        P, width = len(self.keys), len(self.keys) + 6 * len(chosen)
        blocks = []
        for number, touches in enumerate(chosen):
            block = np.zeros((len(touches.q), 3, width))
            block[:, :, :P] = touches.columns[:, :, :P]
            block[:, :, P + 6 * number : P + 6 * number + 6] = touches.columns[:, :, P:]
            blocks.append(block / self.noise)
        columns = np.concatenate(blocks)
        information = np.zeros((width, width))
        information[:P, :P] = self.prior
        information[range(P, width), range(P, width)] = PLACE_SD**-2.0
        where = np.concatenate([np.full(len(touches.q), number) for number, touches in enumerate(chosen, start=1)])
        counts = {count, *(each for each in COUNTS if LEAST * len(chosen) <= each <= len(columns))}
        best = {each: exchange(columns, each, starts=2, prior_information=information).rows for each in counts}
        rows = self.rng.permutation(best[count])
        rows = rows[np.argsort(where[rows], kind="stable")]
        names = [name for touches in chosen for name in touches.points]
        drawn = [self.rng.choice(len(where), count, replace=False) for _ in range(RANDOM_DRAWS)]
        errors = [self._error_of(columns[each], information) for each in (rows, *drawn)]
        return TouchPlan(
            placements=tuple(touches.placement for touches in chosen),
            q=np.concatenate([touches.q for touches in chosen])[rows],
            points=tuple(names[row] for row in rows),
            placement=tuple(where[rows].tolist()),
            tip_error=errors[0],
            random_tip_error=float(np.median(errors[1:])),
            tracker_error=self._error_of(_in_one_frame(columns[rows], P), information[: P + 6, : P + 6]),
            error_of={each: self._error_of(columns[best[each]], information) for each in sorted(best)},
        )

    def _error_of(self, columns: Array, information: Array) -> float:
        P = len(self.keys)
        A = columns.reshape(-1, columns.shape[2])
        M = A.T @ A + information
        return self.error(M[:P, :P] - M[:P, P:] @ np.linalg.solve(M[P:, P:], M[P:, :P]) - self.prior)


def postures(arm: Arm, goals: Array, up: Array, rng: np.random.Generator) -> Array:
    """(N, n), rad, random postures of the arm as drawn at goals (N, 3), m, its tool into sockets of axis (3,) and its
    wrist above the table; NaN where none was found."""
    model, out, unsolved = model_of(arm, ()), np.full((len(goals), arm.dof), np.nan), np.arange(len(goals))
    low, high = (np.array([getattr(joint, end) for joint in arm.joints]) for end in ("lower", "upper"))
    for _ in range(TRIES):
        q = rng.uniform(WITHIN * low, WITHIN * high, (len(unsolved), arm.dof))
        for _ in range(STEPS):
            settled = solve_equilibrium(model, poses_of(q))
            step = np.linalg.pinv(joint_jacobian(settled), rcond=0.05) @ (goals[unsolved] - settled.tcp)[:, :, None]
            q = np.clip(q + np.clip(step[:, :, 0], -LONGEST_STEP, LONGEST_STEP), low, high)
        T = frames(model.chain, model.chain.values([*np.ascontiguousarray(q.T)]), len(q))
        good = np.linalg.norm(goals[unsolved] - T[:, -1, :3, 3], axis=1) < REACHED
        good &= -T[:, -1, :3, 2] @ up > INTO
        good &= T[:, -1 - WRIST : -1, 2, 3].min(axis=1) > (arm.table or 0.0) + ABOVE_TABLE
        out[unsolved[good]] = q[good]
        unsolved = unsolved[~good]
        if not len(unsolved):
            break
    return out


def _in_one_frame(columns: Array, P: int) -> Array:
    """(N, 3, P + 6), columns (N, 3, P + 6 K) of touches whose placements stand in one known frame."""
    frames_of = columns[:, :, P:].reshape(len(columns), 3, -1, 6)
    return np.concatenate([columns[:, :, :P], frames_of.sum(axis=2)], axis=2)


def _rigid(points: Array) -> Array:
    """(N, 3, 6), motion of points (N, 3), m, by a shift and by a turn about the origin."""
    return np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -skew(points)], axis=2)
