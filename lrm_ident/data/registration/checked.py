"""Measurements that an arm can have made: read, compared with it, registered to its frame if that is unknown.

And whether measured orientations are those of the arm's tool, or their columns stand in another order.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.conventions import frame_table, motion_of, rigid_motion
from lrm_ident.data.measurement_file.load import read_measured
from lrm_ident.data.measurement_file.measured_columns import without_frozen
from lrm_ident.data.measurement_file.pose_quantity import QUATERNION
from lrm_ident.data.measurements import Measurements, Part, every_pose
from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.registration.distance_check import misread_distances
from lrm_ident.data.registration.hypotheses import Hypothesis
from lrm_ident.data.registration.moved_frame import moved_frame
from lrm_ident.data.registration.point_set import ScoredReading, registered
from lrm_ident.data.registration.reading_check import (
    DOUBTFUL,
    GOOD,
    ReadingCheck,
    check_reading,
    compared_rows,
    scored_as_read,
)
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.data.registration.touched import in_frame_of_touches, misread_touches
from lrm_ident.data.rigid_motion import quaternions, rotation_matrix, rotation_vectors
from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach, total_mass
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.reading import AS_NAMED, Reading
from lrm_math.model.sensed import tool_rotation

MOST, LISTED = 100, 4
FAR, BETTER = np.radians(15.0), 0.5
"""An orientation error that no assembled arm has, and the part of it that another reading must come below."""
AS_COMPUTED = 1e-4
"""Error over the reach that no arm has as drawn: an industrial one has ten times as much."""
NOT_THIS_ARM = np.radians(45.0)
WHAT_ELSE = (
    "is it another arm, or did its base or the tracker move? check the arm file, and which column is which joint"
)


class Misread(FileError):
    """Measurements that their arm cannot have made as they were read; carries the `check` of the comparison.

    Args:
        part: which part of the file `data` are, in words; empty: the whole.
    """

    def __init__(self, data: Measurements, check: ReadingCheck, arm: Arm, part: str = "") -> None:
        self.check, path, stated = check, data.source.path, data.source.stated
        missed = f"as read, {arm.name} misses the positions by {_millimetres(check.read)}"
        imputed = all(scored.hypothesis.imputed for scored in check.found)
        if imputed and (moved := _moved_words(arm, data, check)):
            super().__init__(path, part, f"{missed}; {moved[0]}", moved[1])
            return
        if not check.found:
            what = f"{missed}; no other unit, frame or axes and no sign or order of the joints explains them"
            super().__init__(path, part, what, f"{WHAT_ELSE}{_unused(data)}")
            return
        words = ", or ".join(" and ".join(scored.hypothesis.words) for scored in check.found)
        remedies = ", or ".join(remedy(scored.hypothesis, stated) for scored in check.found)
        if part:
            rows = f"{data.pose[0]}-{data.pose[-1]}"
            remedies = f"correct its rows ({remedies} reads them so), or leave them out: --leave-out {rows}"
        then = f"(then {arm.name}, roughly fitted, misses the positions by {_millimetres(check.found[0])}, as read by "
        super().__init__(path, part, words, f"if so: {remedies} {then}{_millimetres(check.read)}){_unused(data)}")


def _unused(data: Measurements) -> str:
    """That columns are not used, of which one may be what moves the tip, such as a rail below the arm."""
    columns = enumerate_words(data.source.unused, LISTED)
    return f"; not used, though it may move the tip: {columns}" if columns else ""


def load_checked(
    path: Path, arm: Arm, reading: Reading = AS_NAMED, usual: Reading | None = None, part: Part = every_pose
) -> Measurements:
    """Reads measurements and tests whether the arm can have made them.

    Args:
        reading: how to read the numbers; then the file beside the data says, then `usual`, then the columns' names.
        part: chooses poses; the others are neither tested nor taken.

    Raises:
        FileError: naming file, line and column of the first fault.
        Misread: the numbers mean something else, or are of another arm.
    """
    read, beyond = read_measured(path, arm, reading, usual)
    chosen = part(read)
    data = chosen if read.touched else without_frozen(arm, chosen)
    notices = (*_massless(arm), *_check(arm, data))
    for pose, error in beyond:
        if pose in chosen.pose:
            raise error
    located = in_arm_frame(arm, data.noting(*notices))
    for seen in located.of(Orientations):
        check_orientations(arm, located, seen)
    return located


def _as_drawn(arm: Arm, data: Measurements) -> tuple[str, ...]:
    """A notice where the positions are those of the arm as drawn: computed, since no arm is built so exactly."""
    computed = solve_equilibrium(model_of(arm, ()), data.poses).tcp
    error = float(np.sqrt(np.nanmean(((data.tcp - computed) ** 2).sum(axis=1))))
    if error > AS_COMPUTED * reach(arm):
        return ()
    what = f"the positions are those of {arm.name} as drawn, to within {error / MM:.2g} mm"
    return (f"{what}: are they where the arm was sent, not where it was measured?",)


def _massless(arm: Arm) -> tuple[str, ...]:
    """A notice where no body of the arm has a mass, as of a URDF without inertials: then other effects imitate sag."""
    if total_mass(arm):
        return ()
    what = f"{arm.name} has no masses, so its model cannot sag under its own weight and other effects may imitate that"
    return (f"{what}: state mass_g and com_mm of its bodies in the arm file, then fit again",)


def _check(arm: Arm, data: Measurements) -> tuple[str, ...]:
    """Doubts about the reading, in words. Raises `Misread`."""
    if data.touched:
        right = "are the names of the points, their places and the joints right, and is it this arm?"
        _refuse(arm, data, "points that it touched", misread_touches(arm, data), right)
        return ()
    _check_sessions(arm, data)
    check = check_reading(arm, data)
    if check is None:
        for seen in data.of(Distances):
            right = "are their unit, their fixed point and the joints right, and the arm?"
            _refuse(arm, data, "distances", misread_distances(arm, data, seen), right)
        return ()
    if not check.right:
        raise Misread(data, check, arm)
    better = next((scored for scored in check.found if scored.hypothesis.words), None)
    if not check.read.overdetermined:
        return ()
    if better is None:
        doubt = (
            f"as read, {arm.name} misses the positions by {_millimetres(check.read)}, more than an assembled arm does"
        )
        return (f"{doubt}: {WHAT_ELSE}",) if check.read.share > DOUBTFUL else _as_drawn(arm, data)
    words = f"perhaps {' and '.join(better.hypothesis.words)} ({remedy(better.hypothesis, data.source.stated)})"
    return (f"{words}: that comes within {_millimetres(better)}, as read within {_millimetres(check.read)}",)


def _check_sessions(arm: Arm, data: Measurements) -> None:
    """Raises `Misread`: a session that was read wrongly, where another one is right as it is read.

    Together they hide in one another: a few misread rows are taken for wrong measurements, many for a wrong joint.
    """
    session = data.poses.session
    numbers = np.unique(session[data.positions.measured]) if session is not None else ()
    if len(numbers) < 2:
        return
    parts = {int(number): data.take(session == number) for number in numbers}
    scored = {number: scored_as_read(arm, part) for number, part in parts.items()}
    shares = {number: score.share for number, score in scored.items() if score is not None and score.overdetermined}
    if min(shares.values(), default=np.inf) > GOOD:
        return
    for number in (number for number, share in shares.items() if share > DOUBTFUL):
        check = check_reading(arm, parts[number])
        if check is not None and check.found and not check.right:
            raise Misread(parts[number], check, arm, f"session {number}")


def _refuse(arm: Arm, data: Measurements, of: str, misread: tuple[float, Hypothesis | None] | None, right: str) -> None:
    """Raises `FileError`: the arm cannot have been where these were measured, as they were read."""
    if misread:
        missed, mapping = misread
        what = f"as read, {arm.name} misses the {of} by {missed / MM:.3g} mm"
        if mapping is None:
            raise data.source.fault(what, right)
        words = f"{' and '.join(mapping.words)} ({what})"
        raise data.source.fault(words, f"if so: {remedy(mapping, data.source.stated)}")


def in_arm_frame(arm: Arm, data: Measurements) -> Measurements:
    """Measurements in an unknown frame, and touched points, registered to the arm's; others as they are."""
    if data.touched:
        return in_frame_of_touches(arm, data)
    if data.source.reading.frame != "unknown":
        return data
    rows = compared_rows(data)
    if not len(rows):
        right = "leave it out; state distance_from_mm in the arm's frame, or not at all"
        raise data.source.fault("distances alone do not determine the frame that they are in", right)
    motion = registered(arm, data.poses.take(rows), data.tcp[rows])[1]
    frame = frame_table(motion.rotation, motion.translation)
    angle = math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(motion.rotation)) - 1.0) / 2.0))))
    distance = float(np.linalg.norm(motion.translation)) / MM
    reading, stated = (said.model_copy(update={"frame": frame}) for said in (data.source.reading, data.source.stated))
    source = replace(data.source, reading=reading, stated=stated)
    turned = replace(data.turned(*rigid_motion(frame)), source=source)
    return turned.noting(f"registered to the arm: turned by {angle:.1f} deg and moved by {distance:.1f} mm")


def remedy(hypothesis: Hypothesis, stated: Reading) -> str:
    """The options that accept a hypothesis, or what else to do."""
    options = []
    for name, value in hypothesis.reading.said().items():
        if value != getattr(stated, name):
            text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
            options.append(f"--{name.replace('_', '-')}{'=' if text.startswith('-') else ' '}{text}")
    return " and ".join([" ".join(options)] * bool(options) + [hypothesis.remedy] * bool(hypothesis.remedy))


def _moved_words(arm: Arm, data: Measurements, check: ReadingCheck) -> tuple[str, str] | None:
    """What was moved and what to do, in words, if a change of frame explains what no reading does."""
    moved = moved_frame(arm, data)
    if moved is None or moved.score > DOUBTFUL * check.read.spread:
        return None
    by = f"turned by {math.degrees(moved.angle):.1f} deg and moved by {moved.distance / MM:.0f} mm"
    what = f"from pose {moved.first} on the positions are in another frame, {by}: the tracker or the base was moved"
    alone = f"then {moved.score / MM:.3g} mm are missed on either side"
    right = f"give all in one frame, or fit one part: --leave-out {moved.first}-{moved.last}"
    return what, f"{right} ({alone})"


def _millimetres(scored: ScoredReading) -> str:
    value = scored.score / MM
    return f"{value:.3g} mm" if value < 1000.0 else f"{value:.0f} mm"


def check_orientations(arm: Arm, data: Measurements, seen: Orientations) -> None:
    """Compares measured orientations with the arm as drawn.

    Raises `FileError`: the columns look ordered or signed otherwise, the tool's or the measuring frame turned, or the
    orientations are of another arm.
    """
    rows = seen.rows
    if not len(rows):
        return
    rows = rows[spaced_rows(len(rows), MOST)]
    measured, drawn = seen.values[rows], tool_rotation(solve_equilibrium(model_of(arm, ()), data.poses.take(rows)))
    error = _usual_angle(measured @ drawn.transpose(0, 2, 1))
    if error <= FAR:
        return
    nearest = min(_readings(measured, drawn, motion_of(data.source.reading)[0]), key=lambda reading: reading[0])
    what = f"the orientations miss those of {arm.name} by {np.degrees(error):.0f} deg"
    if nearest[0] < BETTER * error:
        raise data.source.fault(
            f"{what}; {nearest[1]}", f"then {np.degrees(nearest[0]):.1f} deg", ", ".join(QUATERNION)
        )
    if error > NOT_THIS_ARM:
        right = "correct [tool] of the arm file, or leave the columns out"
        raise data.source.fault(f"{what}, in whatever order the columns are read", right, ", ".join(QUATERNION))


def _readings(measured: Array, drawn: Array, turn: Array) -> Iterator[tuple[float, str]]:
    """The usual error (rad) of every other reading of the orientations, and what a person does about it."""
    raw = quaternions(turn.T @ measured)
    for order in permutations(range(4)):
        for sign in (1.0, -1.0):
            values = raw[:, order] * [1.0, sign, sign, sign]
            error = _usual_angle(turn @ rotation_matrix(values) @ drawn.transpose(0, 2, 1))
            names = [""] * 4
            for ours, theirs in enumerate(order):
                names[theirs] = QUATERNION[ours]
            words = [] if order == (0, 1, 2, 3) else [f"the four columns look like {', '.join(names)}: rename them so"]
            words += [] if sign > 0 else ["they look like the inverse rotations: negate qx, qy and qz"]
            yield error, "; ".join(words)
    for which, difference in (
        ("tool", drawn.transpose(0, 2, 1) @ measured),
        ("base", measured @ drawn.transpose(0, 2, 1)),
    ):
        mean = _mean(difference)
        angles = ", ".join(f"{angle:.0f}" for angle in np.degrees(rotation_vectors(mean[None])[0]))
        yield (
            _usual_angle(difference @ mean.T),
            f"the frame of the {which} looks turned by ({angles}) deg about x, y, z",
        )


def _usual_angle(rotations: Array) -> float:
    """Median angle of rotations (N, 3, 3), rad."""
    return float(np.median(np.linalg.norm(rotation_vectors(rotations), axis=1)))


def _mean(rotations: Array) -> Array:
    """(3, 3), the rotation nearest to all of them (N, 3, 3) (Moakher 2002, chordal mean)."""
    U, _, Vt = np.linalg.svd(rotations.sum(axis=0))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
