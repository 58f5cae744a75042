"""Check of the reading: can an arm have moved to the measured positions, as they were read or read otherwise?

The measured point set is compared with the nominal arm under few hypotheses. For each set of joint angles the best
similarity (Umeyama 1991), proper and mirrored, determines unit, axes and frame; a coarse fit of the arm's dimensions
then scores them. A real arm's errors stay within the bounds of that fit, a misreading does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.conventions import axes_matrix, axes_words, rigid_motion
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.coarse_fit import trimmed_rms
from lrm_ident.data.registration.column_imputation import imputed_angles, imputed_coordinate
from lrm_ident.data.registration.gravity_directions import hung_otherwise
from lrm_ident.data.registration.hypotheses import (
    COMPOUND,
    SIMPLE,
    Hypothesis,
    joint_hypotheses,
    nearest_unit,
    one_axis,
    other_signs,
    with_axes,
    with_free_frame,
    with_unit,
)
from lrm_ident.data.registration.point_set import PointSet, ScoredReading, nominal_tcp, spread_of
from lrm_ident.data.registration.row_choice import drawn_rows
from lrm_ident.data.registration.similarity import Similarity, robust_similarity
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import read_arm, shipped_arms
from lrm_math.arrays import Array
from lrm_math.model.reading import FrameTable

LEAST_POSES = 6
SAME_POSE = 1e-6  # rad
MOST_POSES = 100
LOOKED_AT, WORTH = 10, 2.0
"""Number of similarities looked at closely, the simplest first, and how much worse than the best one they may be."""
FLOOR = 0.01
"""Share of the points' spread below which a score is as good as any."""
BETTER = 0.5
"""A misreading is reported only if it brings the score below this part of it."""
GOOD = 0.02
"""Share of the spread below which no less simple reading is looked for."""
PLAUSIBLE = 0.15
"""Share of the spread that a right reading stays below."""
ALIKE = 1.5
"""Readings whose scores differ by less cannot be distinguished; the simplest of them is taken."""
DOUBTFUL = 0.06
"""Share of the spread beyond which a reading is doubtful: arms with errors of 10 deg and 20 mm stay below 0.02."""
IMPROVED, AGREED = 0.33, 0.8
"""If a column holds another quantity: the most that is left of the score with it imputed from the others, and the most
that both agree: the coefficient of determination, of angles by their circular variance (Mardia & Jupp 2000). After a
push or a slip meanwhile they agree to more than 0.9."""
SAGS_SO = 0.75
"""Share of the score below which an arm sags as gravity of another direction makes it: of five arms at 60 poses the
true direction leaves 0.02 to 0.66 of what the others do."""
BESIDE = 0.1
"""Share of the spread that a sign moves the positions by where the floor may hide it: the tip is near that axis."""
SCALE_TOLERANCE = 0.35
RIGHT_ANGLED = 0.5  # Frobenius norm of a rotation less a signed permutation: about 20 deg
MAX_RELATIVE_ERROR = 0.3
"""Share of the spread beyond which the data are of another arm, even if no other reading is better."""


@dataclass(frozen=True)
class ReadingCheck:
    """Result of the comparison.

    Attributes:
        read: the file as it was read.
        found: the simplest readings that explain the data, the best first; empty if none does.
    """

    read: ScoredReading
    found: tuple[ScoredReading, ...]

    @property
    def right(self) -> bool:
        """Whether the data can be taken as they were read."""
        best = min((scored.share for scored in self.found), default=np.inf)
        if not self.read.overdetermined:
            return self.read.share <= MAX_RELATIVE_ERROR
        return self.read.share <= min(max(FLOOR, best / BETTER), MAX_RELATIVE_ERROR)


def check_reading(arm: Arm, data: Measurements) -> ReadingCheck | None:
    """Compares measurements with the nominal arm; None if there are too few poses, or all are one."""
    points = _comparable(arm, data)
    if points is None:
        return None
    rows, read = compared_rows(data), points.scored(points.as_read)
    hung = _hung_otherwise(points, read)
    if read.share <= FLOOR:
        return ReadingCheck(read, hung or (_hidden_sign(points, read) or read,))
    every = [read, *_alternatives(points), *hung]
    if min(scored.share for scored in every) > GOOD:
        every += _other_arms(points)
    if read.overdetermined and min(scored.share for scored in every) > DOUBTFUL:
        every += [*_unrelated_columns(points, read), *_shifted_rows(points, data, rows)]
    best = min(scored.share for scored in every)
    alike = [scored for scored in every if scored.share <= max(ALIKE * best, FLOOR)]
    simplest = min(scored.hypothesis.complexity for scored in alike)
    chosen = [s for s in alike if s.hypothesis.complexity == simplest and s.share <= PLAUSIBLE]
    return ReadingCheck(read, tuple(sorted(chosen, key=lambda scored: scored.share)))


def scored_as_read(arm: Arm, data: Measurements) -> ScoredReading | None:
    """Measurements as they were read, beside the nominal arm; None as in `check_reading`."""
    points = _comparable(arm, data)
    return None if points is None else points.scored(points.as_read)


def _comparable(arm: Arm, data: Measurements) -> PointSet | None:
    """The positions that are compared; None if there are too few poses, or all are one."""
    rows = compared_rows(data)
    if len(rows) < LEAST_POSES:
        return None
    points = PointSet(arm, data.poses.take(rows), data.tcp[rows], data.source.stated)
    one_pose = np.ptp(points.poses.q, axis=0).max() < SAME_POSE
    return None if one_pose or spread_of(nominal_tcp(arm, points.poses)) == 0.0 else points


def compared_rows(data: Measurements) -> NDArray[np.int64]:
    """Rows with a position; of many, `MOST_POSES` drawn at random, always the same."""
    return data.positions.rows[drawn_rows(len(data.positions.rows), MOST_POSES)]


def _before_frame(points: PointSet) -> PointSet:
    """The points in the frame that they were measured in, if that is known: another reading may have another one."""
    if not isinstance(points.reading.frame, FrameTable):
        return points
    rotation, translation = rigid_motion(points.reading.frame)
    unknown = points.reading.model_copy(update={"frame": "unknown"})
    return replace(points, tcp=(points.tcp - translation) @ rotation, reading=unknown)


def _other_frames(points: PointSet) -> Iterator[Hypothesis]:
    """The arm's own frame, and one that nothing is known of, where a known one may be that of other measurements."""
    if isinstance(points.reading.frame, FrameTable):
        found_in = _before_frame(points).as_read
        yield found_in.also("the positions look measured in the frame of the arm file", SIMPLE, frame="arm")
        yield with_free_frame(found_in, mirrored=False)


def _alternatives(points: PointSet) -> Iterator[ScoredReading]:
    """Other readings, the simplest first, until one explains the data and all others as simple have been looked at."""
    enough = np.inf
    proposals = [*_proposals(_before_frame(points)), *_other_frames(points)]
    for proposal in sorted(proposals, key=lambda proposal: proposal.complexity):
        if proposal.complexity > enough:
            return
        scored = points.scored(proposal)
        if scored.share <= GOOD:
            enough = proposal.complexity
        yield scored


def _proposals(points: PointSet) -> Iterator[Hypothesis]:
    """Readings that a similarity suggests, of the joint angles for which it misses least."""
    candidates = []
    if points.reading.axes is None and not isinstance(points.reading.frame, FrameTable | str):
        yield from one_axis(points.as_read, nominal_tcp(points.arm, points.poses), SCALE_TOLERANCE)
    for joints in joint_hypotheses(points.as_read, points.arm):
        nominal = nominal_tcp(points.arm, replace(points.poses, q=joints.q))
        for mirrored in (False, True):
            motion = robust_similarity(points.tcp, nominal, mirrored)
            misfit = trimmed_rms(np.linalg.norm(nominal - motion.apply(points.tcp), axis=1))
            candidates.append((misfit / max(spread_of(nominal), 1e-9), joints, motion, mirrored))
    best = min(misfit for misfit, *_ in candidates)
    worth = [candidate for candidate in candidates if candidate[0] <= WORTH * best]
    worth.sort(key=lambda candidate: (candidate[1].complexity, candidate[0]))
    for _, joints, motion, mirrored in worth[:LOOKED_AT]:
        yield from _positions(joints, motion, mirrored)


def _positions(joints: Hypothesis, motion: Similarity, mirrored: bool) -> Iterator[Hypothesis]:
    """Readings of the positions that agree with a similarity: as read, other axes, another frame."""
    how = joints.reading
    unit = nearest_unit(how.unit or "mm", motion.scale, SCALE_TOLERANCE)
    if unit is None:
        return
    scaled = with_unit(joints, *unit)
    turn = axes_matrix(axes_words(motion.rotation))
    if how.frame != "unknown":
        if scaled.words and not mirrored:
            yield scaled
        right_angled = float(np.linalg.norm(motion.rotation - turn)) < RIGHT_ANGLED
        if right_angled and not np.array_equal(turn, np.eye(3)):
            yield with_axes(scaled, turn)
    if how.frame != "unknown" or mirrored or scaled.words:
        yield with_free_frame(scaled, mirrored)


def _other_arms(points: PointSet) -> Iterator[ScoredReading]:
    """The data as read, of each shipped arm with as many joints."""
    for name, path in shipped_arms().items():
        other = read_arm(path)
        if other.dof == points.arm.dof and other != points.arm:
            words = f"these look like measurements of {name}"
            yield replace(points, arm=other).scored(points.as_read.also(words, COMPOUND, f"--arm {name}"))


def _hung_otherwise(points: PointSet, read: ScoredReading) -> tuple[ScoredReading, ...]:
    """The data as read, of the arm with gravity in the best other direction, where the data do not state it.

    Empty if it does not explain what neither the stated direction nor an arm without weight does.
    """
    if points.poses.gravity is not None or not read.overdetermined:
        return ()
    said, every = "gravity looks to act in another direction on the arm", []
    for arm, words in hung_otherwise(points.arm):
        hypothesis = points.as_read.also(said, COMPOUND, f"state {words} in the arm file")
        every.append(replace(points, arm=arm).scored(hypothesis))
    best = min(every, key=lambda scored: scored.score)
    return (best,) if _sags_so(points, read, best) else ()


def _sags_so(points: PointSet, read: ScoredReading, hung: ScoredReading) -> bool:
    """Whether an arm with gravity in another direction explains what neither the stated one nor a rigid arm does."""
    if hung.score >= SAGS_SO * read.score:
        return False
    weightless = replace(points, arm=replace(points.arm, gravity=(0.0, 0.0, 0.0)))
    return hung.score < SAGS_SO * weightless.scored(points.as_read).score


def _hidden_sign(points: PointSet, read: ScoredReading) -> ScoredReading | None:
    """The sign of a joint near whose axis the tip stands, where the other one leaves a part of what this one does."""
    if not read.overdetermined:
        return None
    nominal = nominal_tcp(points.arm, points.poses)
    every = (hypothesis for hypothesis in other_signs(points.as_read) if hypothesis.complexity == SIMPLE)
    moved = ((sign, nominal_tcp(points.arm, replace(points.poses, q=sign.q)) - nominal) for sign in every)
    near = [sign for sign, off in moved if np.linalg.norm(off, axis=1).max() < BESIDE * read.spread]
    best = min(map(points.scored, near), key=lambda scored: scored.score, default=read)
    return best if best.score < IMPROVED * read.score else None


def _unrelated_columns(points: PointSet, read: ScoredReading) -> Iterator[ScoredReading]:
    """The data with one column imputed from the others, where they then fit much better and the two hardly agree."""
    if points.reading.frame != "unknown":
        every = (*_with_imputed_angles(points), *_with_imputed_coordinates(points))
        yield from (s for s in map(points.scored, every) if s.share < IMPROVED * read.share)


def _shifted_rows(points: PointSet, data: Measurements, rows: NDArray[np.int64]) -> Iterator[ScoredReading]:
    """The positions, each with the joint angles of the row before or after, all or from one pose on."""
    for by, which in ((-1, "before"), (1, "after")):
        first = _first_shifted(points, data, by)
        kept = rows[(rows < first) | ((rows + by >= 0) & (rows + by < len(data)))]
        moved = replace(points, poses=data.poses.take(kept), tcp=data.tcp[kept])
        words = f"each position belongs to the joint angles of the row {which}"
        remedy = "shift the columns of the positions by one row"
        if first:
            words, remedy = (f"from pose {data.pose[first]} on {part}" for part in (words, remedy))
            missing, doubled = ("a position", "a row of angles")[::by]
            remedy += f" ({missing} is missing there, or {doubled} is there twice)"
        hypothesis = moved.as_read.also(words, COMPOUND, remedy)
        yield moved.scored(replace(hypothesis, q=data.poses.q[np.where(kept < first, kept, kept + by)]))


def _first_shifted(points: PointSet, data: Measurements, by: int) -> int:
    """The row from which positions are nearest to the arm with the angles of the row `by` on; 0: all, or not known.

    A change point by least absolute deviations (Bai 1995), where the positions are in the frame of the arm.
    """
    if points.reading.frame == "unknown":
        return 0
    rows = data.positions.rows
    rows = rows[(rows + by >= 0) & (rows + by < len(data))]
    as_read, shifted = (
        np.linalg.norm(nominal_tcp(points.arm, data.poses.take(rows + step)) - data.tcp[rows], axis=1)
        for step in (0, by)
    )
    change = int(np.argmin(np.concatenate([[0.0], np.cumsum(as_read - shifted)])))
    return int(rows[change]) if 0 < change < len(rows) else 0


def _with_imputed_angles(points: PointSet) -> Iterator[Hypothesis]:
    for joint, number in enumerate(points.reading.joint_order or range(1, points.arm.dof + 1)):
        angles = imputed_angles(points.arm, points.poses, points.tcp, joint)
        if _dispersion(angles - points.poses.q[:, joint]) < (1.0 - AGREED) * _dispersion(angles):
            continue
        words = f"the angles of joint {joint + 1} do not belong to these positions"
        remedy = f"look into the column of q{number}: its unit, its sign, its rows"
        yield replace(points.as_read.also(words, COMPOUND, remedy), imputed=True).with_joint(joint, angles)


def _dispersion(angles: Array) -> float:
    """Circular variance of angles (N,), rad: one less their mean resultant length (Mardia & Jupp 2000)."""
    return 1.0 - float(np.abs(np.exp(1j * angles).mean()))


def _with_imputed_coordinates(points: PointSet) -> Iterator[Hypothesis]:
    for axis, name in enumerate("xyz"):
        tcp = points.tcp.copy()
        tcp[:, axis] = imputed_coordinate(points.arm, points.poses, points.tcp, axis)
        if np.var(tcp[:, axis] - points.tcp[:, axis]) < (1.0 - AGREED) * np.var(tcp[:, axis]):
            continue
        words, remedy = f"{name} does not belong to these angles", "look into its column: its unit, its sign, its rows"
        yield replace(points.as_read.also(words, COMPOUND, remedy), tcp=tcp, imputed=True)
