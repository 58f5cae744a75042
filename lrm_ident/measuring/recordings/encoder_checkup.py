"""Checkup of a teleoperated arm by its encoders: covariates of `action − state` at rest.

Command and encoder of a sound servo agree at rest to a few of its counts. Where they do not, the difference follows
what causes it: gravity's torque (the servo yields), the side that the joint came from (a dead band), nothing (leader
and follower, or command and encoder, have other zeros), time (they warm up), the command (a gain), or it changes once
and for all (a slip). Terms enter a linear regression one at a time, the best first, while they are significant among
all that were tried. What was misread is tried before (`misread_joints`); what no term explains is a finding, too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from lrm_ident.measuring.recordings.lerobot import Integers, LeRobotFrames
from lrm_ident.measuring.recordings.misread_joints import Misreading, Mistake, read_alike, within_limits
from lrm_ident.residual.significance import f_test_p_value
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

Term = Literal["droop", "dead band", "offset", "drift", "slip", "gain"]
TERMS: tuple[Term, ...] = get_args(Term)
Cause = Term | Mistake | Literal["unexplained", "not read"]
MATTERS = float(np.radians(0.5))
"""rad: with 0.4 m of reach, 3.5 mm at the tip. What is smaller is not named."""
SIGNIFICANT = 1e-3
"""Largest p value, times the number of terms tried at all joints."""
TURN = float(np.radians(1.0))
"""A joint that is sent back by more has turned round."""
FEWEST_RESTS, FEWEST_BESIDE = 12, 4
"""Fewest rests of a dataset; before and after a jump."""
WARMING_S = (60.0, 240.0, 960.0)
"""Time constants of a drift that are tried, beside one that goes on."""
MOST_TERMS = 6


@dataclass(frozen=True)
class EncoderFinding:
    """One cause at one joint.

    Attributes:
        joint: from 0. size: rad, by which command and encoder differ by it at most, of a dead band from side to side,
            of what is unexplained its RMS; 0 where an angle was not read.
        slope: rad/N·m of a droop; of a gain, how far it turns of what is commanded; else 0.
        sign: of `state − action` where the term is positive.
        rest: of a slip, the first rest after it, from 0; else None. p_value: times the number of terms tried.
        misread: what was mistaken. frames: in which an angle was not read, from 0.
    """

    joint: int
    cause: Cause
    size: float
    slope: float
    sign: int
    rest: int | None
    p_value: float
    misread: Misreading | None = None
    frames: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class EncoderCheckup:
    """Findings, largest first, and what they were found in.

    Attributes:
        rests: how many. before, after: (n,), RMS of `action − state` at rest, and of what the findings leave (rad).
        episode: (R,), of each rest.
    """

    findings: tuple[EncoderFinding, ...]
    rests: int
    before: Array
    after: Array
    episode: Integers


@dataclass(frozen=True, eq=False)
class _Term:
    """A column (R,) of a regression. `tried`: how many like it compete. `rest`: the first after a slip."""

    cause: Term
    column: Array
    tried: int
    rest: int | None = None


def checkup(frames: LeRobotFrames, arm: Arm, dwell: float) -> EncoderCheckup:
    """Names what ails an arm by its encoders alone. Raises `LrmError`: too few rests."""
    rests = list(frames.rests(dwell))
    if len(rests) < FEWEST_RESTS:
        what = f"{len(rests)} rests of {dwell:g} s or more; should be {FEWEST_RESTS} at least"
        raise LrmError(f"{what}: stop for a moment now and then while you teleoperate")
    last = np.array([rows[-1] for rows in rests])
    command, state = (np.array([v[rows].mean(axis=0) for rows in rests]) for v in (frames.command, frames.feedback))
    before = np.sqrt(np.mean((state - command) ** 2, axis=0))
    command, state, mistakes = read_alike(command, state)
    command, state, beyond = within_limits(arm, command, state)
    torque = solve_equilibrium(model_of(arm, ()), poses_of(state)).joint_torque
    side, time = last_sides(frames)[last], elapsed(frames)[last]
    findings = [
        EncoderFinding(misread.joint, misread.mistake, misread.size, 0.0, 1, None, 0.0, misread)
        for misread in (*mistakes, *beyond)
    ]
    findings += list(_not_read(frames))
    after = np.empty(arm.dof)
    for joint in range(arm.dof):
        terms = list(_terms(command[:, joint], torque[:, joint], side[:, joint], time, frames.t[last]))
        named, unexplained = _select((state - command)[:, joint], terms, arm.dof * sum(1 for _ in terms))
        findings += [finding for term in TERMS if (finding := _finding(joint, term, named)) and finding.size >= MATTERS]
        after[joint] = np.sqrt(np.mean(unexplained**2))
        if after[joint] >= MATTERS:
            findings.append(EncoderFinding(joint, "unexplained", float(after[joint]), 0.0, 1, None, 0.0))
    findings.sort(key=lambda finding: -finding.size)
    return EncoderCheckup(tuple(findings), len(rests), before, after, frames.episode[last])


def _not_read(frames: LeRobotFrames) -> Iterator[EncoderFinding]:
    """Joints without a number in some frames, which are left out."""
    for joint, missing in enumerate(frames.missing.T):
        if missing.any():
            rows = tuple(np.flatnonzero(missing).tolist())
            yield EncoderFinding(joint, "not read", 0.0, 0.0, 1, None, 0.0, frames=rows)


def _terms(command: Array, torque: Array, side: Array, time: Array, in_episode: Array) -> Iterator[_Term]:
    """A covariate of the difference at one joint, over R rests."""
    count = len(time)
    yield _Term("offset", np.ones(count), 1)
    yield _Term("droop", torque, 1)
    yield _Term("dead band", side, 1)
    if np.ptp(command) > 2.0 * TURN:  # else no other than an offset
        yield _Term("gain", command, 1)
    shapes = [1.0 - np.exp(-t / T) for T in WARMING_S for t in (time, in_episode)]
    shapes.append(time / max(time[-1], 1.0))
    for shape in shapes:
        yield _Term("drift", shape, len(shapes))
    for rest in range(FEWEST_BESIDE, count - FEWEST_BESIDE + 1):
        yield _Term("slip", (np.arange(count) >= rest).astype(np.float64), count, rest)


def _select(error: Array, terms: list[_Term], tried: int) -> tuple[list[tuple[_Term, float, float]], Array]:
    """Forward selection: terms with their coefficients and p values (times `tried`), and the residual (R,)."""
    count, chosen, p_values = len(error), list[_Term](), list[float]()
    unexplained, coefficients = error, np.empty(0)
    while len(chosen) < MOST_TERMS:
        columns = np.stack([term.column for term in chosen], axis=1) if chosen else np.empty((count, 0))
        fits = [_fit(np.column_stack([columns, term.column]), error) for term in terms]
        costs = [
            count * np.log(fit[1] @ fit[1] + 1e-300) + 2.0 * np.log(t.tried) for fit, t in zip(fits, terms, strict=True)
        ]
        best = int(np.argmin(costs))
        after = fits[best][1]
        p = tried * f_test_p_value(float(unexplained @ unexplained), float(after @ after), 1, count - len(chosen) - 1)
        if not p < SIGNIFICANT:
            break
        chosen.append(terms[best])
        p_values.append(p)
        coefficients, unexplained = fits[best]
    return list(zip(chosen, coefficients.tolist(), p_values, strict=True)), unexplained


def _fit(columns: Array, error: Array) -> tuple[Array, Array]:
    """Coefficients and residual of least squares."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    coefficients = np.linalg.lstsq(columns / scale, error, rcond=1e-9)[0] / scale
    return coefficients, error - columns @ coefficients


def _finding(joint: int, cause: Term, named: list[tuple[_Term, float, float]]) -> EncoderFinding | None:
    """A cause by all of its terms at a joint; None without any. Several exponentials are one drift."""
    terms_of_cause = [(term, c, p) for term, c, p in named if term.cause == cause]
    if not terms_of_cause:
        return None
    first, c, p = terms_of_cause[0]
    made = sum((c * term.column for term, c, _ in terms_of_cause), np.zeros(len(first.column)))
    size = np.abs(made).max() if cause in ("offset", "droop", "gain") else np.ptp(made)
    slope = {"droop": abs(c), "gain": 1.0 + c}.get(cause, 0.0)
    return EncoderFinding(joint, cause, float(size), slope, 1 if c > 0.0 else -1, first.rest, min(p, 1.0))


def last_sides(frames: LeRobotFrames) -> Array:
    """(N, n), sign of each joint's last turn by more than `TURN`; 0 before the first of an episode."""
    side = np.zeros_like(frames.command)
    extreme, position = frames.command[0].copy(), np.zeros(frames.command.shape[1])
    for row, command in enumerate(frames.command):
        if row and frames.episode[row] != frames.episode[row - 1]:
            extreme, position = command.copy(), np.zeros_like(position)
        extreme = np.where(np.isnan(extreme), command, extreme)
        extreme = np.where((command - extreme) * position > 0.0, command, extreme)  # it goes on
        turned = np.abs(command - extreme) > TURN
        position = np.where(turned, np.sign(command - extreme), position)
        extreme = np.where(turned, command, extreme)
        side[row] = position
    return side


def elapsed(frames: LeRobotFrames) -> Array:
    """(N,), s, since the first frame; the time between episodes is not recorded, and counts as none."""
    starts = np.flatnonzero(np.diff(frames.episode, prepend=frames.episode[0] - 1))
    lengths = [
        frames.t[end - 1] - frames.t[start] for start, end in zip(starts, [*starts[1:], len(frames.t)], strict=True)
    ]
    begun = np.cumsum([0.0, *lengths[:-1]])
    which = np.searchsorted(starts, np.arange(len(frames.t)), side="right") - 1
    return np.asarray(begun[which] + frames.t - frames.t[starts[which]])
