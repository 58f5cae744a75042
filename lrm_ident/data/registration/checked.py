"""Measurements that an arm can have made: read, compared with it, registered to its frame if that is unknown."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.apply_reading import frame_table, rigid_motion
from lrm_ident.data.measurement_file.load import load_measurements, without_frozen
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.pose_table import BeyondLimits
from lrm_ident.data.registration.attitude_check import check_attitude
from lrm_ident.data.registration.hypotheses import Hypothesis
from lrm_ident.data.registration.reading_check import ReadingCheck, Scored, check_reading, compared_rows, registered
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.errors import FileError
from lrm_math.model.reading import AS_NAMED, Reading


class Misread(FileError):
    """Measurements that their arm cannot have made as they were read; carries the `check` of the comparison."""

    def __init__(self, path: Path, check: ReadingCheck, arm: Arm, stated: Reading) -> None:
        self.check = check
        missed = f"as read, {arm.name} misses the positions by {_millimetres(check.read)}"
        if not check.found:
            what = f"{missed}; no other unit, frame or axes and no sign or order of the joints explains them"
            super().__init__(path, "", what, "is it another arm? check the arm file, and which column is which joint")
            return
        words = ", or ".join(" and ".join(scored.hypothesis.words) for scored in check.found)
        remedies = ", or ".join(remedy(scored.hypothesis, stated) for scored in check.found)
        then = f"(then {arm.name} misses the positions by {_millimetres(check.found[0])}, as read by "
        super().__init__(path, "", words, f"if so: {remedies} {then}{_millimetres(check.read)})")


def load_checked(path: Path, arm: Arm, reading: Reading = AS_NAMED, usual: Reading | None = None) -> Measurements:
    """Reads measurements and tests whether the arm can have made them.

    Args:
        reading: how to read the numbers; then the file beside the data says, then `usual`, then the columns' names.

    Raises:
        FileError: naming file, line and column of the first fault.
        Misread: the numbers mean something else, or are of another arm.
    """
    try:
        read = load_measurements(path, arm, reading, usual)
    except BeyondLimits:
        free = tuple(replace(joint, lower=-math.inf, upper=math.inf) for joint in arm.joints)
        _check(arm, load_measurements(path, replace(arm, joints=free), reading, usual))
        raise
    data = without_frozen(arm, read)
    notices = _check(arm, data)
    found = in_arm_frame(arm, replace(data, notices=(*data.notices, *notices)))
    check_attitude(arm, found)
    return found


def _check(arm: Arm, data: Measurements) -> tuple[str, ...]:
    """Doubts about the reading, in words. Raises `Misread`."""
    check = check_reading(arm, data)
    if check is None:
        return ()
    if not check.right:
        raise Misread(data.path, check, arm, data.stated)
    better = next((scored for scored in check.found if scored.hypothesis.words), None)
    if better is None or not check.read.overdetermined:
        return ()
    words = f"perhaps {' and '.join(better.hypothesis.words)} ({remedy(better.hypothesis, data.stated)})"
    return (f"{words}: that comes within {_millimetres(better)}, as read within {_millimetres(check.read)}",)


def in_arm_frame(arm: Arm, data: Measurements) -> Measurements:
    """Measurements in an unknown frame, registered to the arm's; others as they are."""
    if data.reading.frame != "unknown":
        return data
    rows = compared_rows(data)
    if not len(rows):
        right = "leave it out; state distance_from_mm in the arm's frame, or not at all"
        raise FileError(data.path, "", "distances alone do not determine the frame that they are in", right)
    motion = registered(arm, data.poses.take(rows), data.tcp[rows])[1]
    frame = frame_table(motion.rotation, motion.translation)
    angle = math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(motion.rotation)) - 1.0) / 2.0))))
    distance = float(np.linalg.norm(motion.translation)) / MM
    return replace(
        data.turned(*rigid_motion(frame)),
        reading=data.reading.model_copy(update={"frame": frame}),
        stated=data.stated.model_copy(update={"frame": frame}),
        notices=(*data.notices, f"registered to the arm: turned by {angle:.1f} deg and moved by {distance:.1f} mm"),
    )


def remedy(hypothesis: Hypothesis, stated: Reading) -> str:
    """The options that accept a hypothesis, or what else to do."""
    options = []
    for name, value in hypothesis.reading.said().items():
        if value != getattr(stated, name):
            text = ",".join(map(str, value)) if isinstance(value, list) else str(value)
            options.append(f"--{name.replace('_', '-')}{'=' if text.startswith('-') else ' '}{text}")
    return " ".join([*options, *([hypothesis.remedy] if hypothesis.remedy else [])])


def _millimetres(scored: Scored) -> str:
    value = scored.score / MM
    return f"{value:.3g} mm" if value < 1000.0 else f"{value:.0f} mm"
