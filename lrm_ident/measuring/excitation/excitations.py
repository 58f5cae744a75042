"""Safe moves of one joint that excite what lags, rubs or swings: ramps, steps, stairs and chirps (Ljung 1999, ch. 13).

A move begins and ends at rest in one posture and turns one joint, in straight pieces no faster than a given speed.
Moves that leave the limits, come near anything, or cannot be reached by a free way from the first posture are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from lrm_ident.design.candidate_poses import APART, ClearanceRules, floor_above_table, keeps_rules, random_poses
from lrm_ident.measuring.motion.joint_moves import JointMoves
from lrm_ident.measuring.motion.moves import LEAD_S, Moves, followed, steps_of
from lrm_math.arm.arm import Arm, JointLimits
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene
from lrm_math.collision.straight_move import check_path, rigid_bodies
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.motion.motion_model import MotionModel

FRAME_S, MOVE_S, REST_S = 1.0 / 30.0, 6.0, 0.4
"""s: between commands; of a whole move; that it stands at its end at least."""
BEFORE_S = LEAD_S + 0.1
"""s that it stands before it moves."""
POSTURES, TRIED = 6, 60
"""Postures in which moves are offered, and among how many random ones they are found."""
SLOW, SHORTEST_S, STAIR = 0.15, 0.12, np.radians(1.5)
"""Share of the speed of a slow piece; half a period of a chirp's quickest wave; a small step (rad)."""
SAMPLE = np.radians(1.0)
"""rad between poses of a way that are held to the rules."""
INSIDE = np.radians(1.0)
"""rad that a move keeps away from the limits."""
RAMP = 1e-6 / 6.5e-3
"""Law of the daemon's ramp: pulses change by 1 µs in 6.5 ms at most."""
SERVO_SPEED = float(np.radians(30.0))
"""rad/s of arms without pulses, as `lrm-ident measure` drives them."""

Piece = tuple[float, float]
"""Seconds of a straight piece, and where it ends beside the posture (rad)."""


@dataclass(frozen=True, eq=False)
class ExcitingMove:
    """A move of one `joint` (from 0): its `kind`; `t` (K,), s, and `q` (K, n), rad, straight between."""

    kind: str
    joint: int
    t: Array
    q: Array

    def at(self, t: Array) -> Array:
        """(T, n), rad, at times (T,), s."""
        return np.stack([np.interp(t, self.t, column) for column in self.q.T], axis=1)


def ramp_speeds(arm: Arm) -> Array:
    """(n,), rad/s: the fastest that the daemon's ramp turns the joints, or that servos without pulses are driven."""
    servos = [joint.servo for joint in arm.joints]
    return np.array([SERVO_SPEED if s is None else RAMP * _least_turn(s.angle, s.pulse) for s in servos])


def _least_turn(angle: Sequence[float], pulse: Sequence[float]) -> float:
    """rad for a second of pulse, where the table turns least."""
    return float(np.abs(np.diff(angle) / np.diff(pulse)).min())


def offered(arm: Arm, joint: int, speed: float, rules: ClearanceRules, seed: int) -> tuple[ExcitingMove, ...]:
    """Safe moves of a joint (from 0) at a speed (rad/s) at most, in a few postures. Raises `LrmError`: none is safe."""
    ways = CollisionFreePaths.of(arm, rules)
    postures = ways.connected(random_poses(arm, TRIED, rules, seed))
    excitations = []
    for q, scale, sign in product(postures, (1.0, 0.5), (1.0, -1.0)):
        for kind, pieces in _kinds(speed):
            t, offset = _knots(pieces, sign * scale)
            path = np.tile(q, (len(t), 1))
            path[:, joint] += offset
            if ways.free(path):
                excitations.append(ExcitingMove(kind, joint, t, path))
    if not excitations:
        raise LrmError(f"no safe move of joint {joint + 1} was found; give a lower --speed, or other distances")
    return tuple(excitations)


@dataclass(frozen=True, eq=False)
class CollisionFreePaths:
    """Straight ways of an arm that keep its limits, the rules, and the margin between its bodies."""

    arm: Arm
    rules: ClearanceRules
    scene: Scene | None

    @classmethod
    def of(cls, arm: Arm, rules: ClearanceRules) -> CollisionFreePaths:
        """The ways of an arm; without shapes only the lines between its joints are held to the rules."""
        return cls(arm, rules, Scene.of(arm) if arm.shapes.capsules else None)

    def free(self, path: Array) -> bool:
        """Whether straight moves through poses (K, n), rad, are."""
        limits = JointLimits.of(self.arm)
        if min(min(limits.margins(q)) for q in path.tolist()) < INSIDE:
            return False
        if not keeps_rules(self.arm, _sampled(path), self.rules).all():
            return False
        return self.scene is None or check_path(rigid_bodies(self.scene), path, self.rules.body_distance)[0].free

    def connected(self, poses: Array) -> Array:
        """(K, n), as many of the poses as are wanted that a straight free way joins with the first of them."""
        if not len(poses):
            raise LrmError("no random pose keeps the rules: give smaller distances")
        inner = [q for q in poses if min(JointLimits.of(self.arm).margins(q.tolist())) > INSIDE]
        for first in inner:
            poses_found = [first, *(q for q in inner if q is not first and self.free(np.array([first, q])))]
            if len(poses_found) >= POSTURES:
                return np.array(poses_found[:POSTURES])
        return np.array(inner[:1])

    def between(self, a: Array, b: Array, home: Array) -> Array:
        """(K, n), a free way from pose to pose, over the `home` pose where it is not straight."""
        return np.array([a, b]) if self.free(np.array([a, b])) else np.array([a, home, b])


def _sampled(path: Array) -> Array:
    parts = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, int(np.ceil(np.abs(b - a).max() / SAMPLE)))
        parts.append(a + np.arange(1, count + 1)[:, None] / count * (b - a))
    return np.concatenate(parts)


def rules_of(arm: Arm) -> ClearanceRules:
    """The rules of designed poses, above the arm's table."""
    return ClearanceRules(floor=floor_above_table(arm, APART))


def _kinds(v: float) -> Iterator[tuple[str, list[Piece]]]:
    """Names and pieces (s, rad) of all moves, at a speed v (rad/s)."""
    most = MOVE_S - BEFORE_S - REST_S
    for name, share in (("slow ramp", SLOW), ("ramp", 0.4), ("quick ramp", 1.0)):
        a = share * v * most / 4.0
        yield name, [(most / 4.0, a), (most / 2.0, -a), (most / 4.0, 0.0)]
    for name, turn in (("steps", 0.35), ("leaps", 0.8)):
        rest = (most - 4.0 * turn) / 3.0
        ends = [turn * v, 0.0, -turn * v, 0.0]
        yield name, [piece for end in ends for piece in ((turn, end), (rest, end))][:-1]
    yield "stairs", list(_stairs(v, most))
    yield "chirp", list(_chirp(v, most))
    slow, rest = 0.35 * most, 0.1 * most
    a = SLOW * v * slow
    yield "slow there, quick back", [(slow, a), (a / v, 0.0), (rest, 0.0), (slow, -a), (a / v, 0.0)]
    yield "small waves", list(_waves(v, most))


def _stairs(v: float, most: float) -> Iterator[Piece]:
    """Small steps up and down, with rests between."""
    turn, rest = STAIR / v, 0.4
    many = int(most / (turn + rest)) // 2
    for at in (*range(1, many + 1), *range(many - 1, -1, -1)):
        yield turn, at * STAIR
        yield rest, at * STAIR


def _chirp(v: float, most: float) -> Iterator[Piece]:
    """Waves at full speed, quicker and smaller from one to the next."""
    half, left, up = 0.8, most, 1.0
    yield 0.5 * half, 0.5 * half * v
    left -= 0.5 * half
    at = 0.5 * half * v
    while left > 2.0 * half:
        half, up = max(0.85 * half, SHORTEST_S), -up
        end = up * 0.5 * half * v
        turn = abs(end - at) / v
        yield turn, end
        left, at = left - turn, end
    yield abs(at) / v, 0.0


def _waves(v: float, most: float) -> Iterator[Piece]:
    """Waves of one size, quicker from one to the next."""
    share, left, at, up = 2.0 * SLOW, most, 0.0, 1.0
    size = 2.0 * STAIR
    while True:
        end = up * size
        turn = abs(end - at) / (share * v)
        if left - turn < size / (share * v):
            break
        yield turn, end
        left, at, up, share = left - turn, end, -up, min(1.15 * share, 1.0)
    yield abs(at) / (share * v), 0.0


def _knots(pieces: Sequence[Piece], scale: float) -> tuple[Array, Array]:
    """Times (K,), s, and offsets (K,), rad, of a move that stands before and after its pieces and ends at zero."""
    t, x = [0.0, BEFORE_S], [0.0, 0.0]
    for seconds, end in pieces:
        t.append(t[-1] + seconds)
        x.append(scale * end)
    t.append(max(MOVE_S, t[-1] + REST_S))
    x.append(x[-1])
    return np.array(t), np.array(x)


def as_moves(arm: Arm, moves: Sequence[ExcitingMove], noise: float, smooth: bool) -> Moves:
    """The moves as if they had been recorded, where every reading is the command. `noise`: of a reading (rad).

    `smooth`: whether commands change at every step of the simulation, or with the frames.
    """
    T, n = round(max(move.t[-1] for move in moves) / FRAME_S) + 1, steps_of(FRAME_S)
    t = np.arange(T) * FRAME_S
    command = np.array([move.at(t) for move in moves])
    fine = (np.arange((T - 1) * n) + 0.5) * FRAME_S / n
    told = np.array([move.at(fine) for move in moves]) if smooth else np.repeat(command[:, :-1], n, axis=1)
    counted = np.tile(t >= LEAD_S - 1e-9, (len(moves), 1))
    return Moves(
        arm, FRAME_S, command, told, command, counted, np.arange(len(moves)), np.full(arm.dof, noise),
        followed(command, FRAME_S), "designed moves",
    )  # fmt: skip


def random_moves(
    arm: Arm, count: int, speeds: Array, rules: ClearanceRules, rng: np.random.Generator
) -> tuple[ExcitingMove, ...]:
    """Moves as people make them without a design: to random free postures at speeds (n,), rad/s, with rests between.

    Raises `LrmError`: no two postures have a free way.
    """
    ways = CollisionFreePaths.of(arm, rules)
    poses = random_poses(arm, TRIED, rules, int(rng.integers(1 << 31)))
    here, moves_found = ways.connected(poses)[0], []
    for _ in range(count):
        t, q = [0.0, BEFORE_S], [here, here]
        while t[-1] < MOVE_S - REST_S:
            goal = next((b for b in poses[rng.permutation(len(poses))] if ways.free(np.array([here, b]))), None)
            if goal is None:
                raise LrmError("no random pose is reached on a free way: give smaller distances")
            seconds = max(float(np.max(np.abs(goal - here) / speeds)), FRAME_S)
            share = min(1.0, (MOVE_S - REST_S - t[-1]) / seconds)
            here = here + share * (goal - here)
            t += [t[-1] + share * seconds, min(t[-1] + share * seconds + rng.uniform(0.6, 1.6), MOVE_S)]
            q += [here, here]
        t[-1] = MOVE_S
        moves_found.append(ExcitingMove("random", -1, np.array(t), np.array(q)))
    return tuple(moves_found)


def measured(moves: Moves, joint: int, by_tip: bool) -> JointMoves:
    """What is measured of a joint (from 0) in moves: its encoder, or the tip's way (m) about its axis."""
    data = moves.measured(MotionModel.nominal(moves.arm), [joint])[0]
    if not by_tip:
        return data
    S, T, n = moves.command.shape
    chain = chain_of(moves.arm)
    geometry = chain_geometry(chain, chain.values(list(moves.command.reshape(-1, n).T)), S * T)
    slot = chain.joint_slots[joint]
    arm_of_tip = np.cross(geometry.axis[slot].T, geometry.tcp.T - geometry.origin[slot].T)
    lever = np.linalg.norm(arm_of_tip, axis=1).reshape(S, T, 1)
    return replace(data, lever=lever, target=lever * data.target)
