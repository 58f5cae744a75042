"""Sentences on poses: what they cannot show, and where a verdict of them holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.wording import enumerate_words, in_mm
from lrm_ident.residual.data_audit import Limitation, LimitationKind, MeasuredAngles
from lrm_ident.residual.influential_poses import InfluentialPoses

INFLUENTIAL_SHOWN = 3


def influential_poses_sentence(poses: InfluentialPoses, numbers: NDArray[np.int64]) -> str:
    """That some poses alone determine the model where they are. `numbers`: (N,), of all poses."""
    far = [f"{numbers[row]} ({in_mm(size)} mm)" for row, size in zip(poses.rows, poses.distances, strict=True)]
    which, them = ("pose", "it") if len(far) == 1 else ("poses", "them")
    listed = enumerate_words(far, INFLUENTIAL_SHOWN)
    return (
        f"Most of the held-out error is that of {which} {listed}: the other poses do not predict {them}. "
        f"They have {in_mm(poses.others)} mm RMS. Measure more poses nearby: no other shows what the arm does there."
    )


def limitation_sentence(limitation: Limitation) -> str:
    """What some poses cannot show, and why."""
    joints = _joints(limitation.joints)
    match limitation.kind:
        case LimitationKind.FEW_ANGLES:
            least, most = limitation.numbers
            levels = f"{least:g}" if least == most else f"{least:g} to {most:g}"
            each = "at each of " if len(limitation.joints) > 1 else "at "
            return f"few angles: {levels} different ones {each}{joints}, so different causes look alike"
        case LimitationKind.ORDER:
            correlation = limitation.numbers[0]
            return f"order: measured in the order of {joints} (correlation {correlation:.2f}), so drift looks the same"
        case LimitationKind.NO_REVERSAL:
            return f"no reversal: {joints} always came from one side, so friction there cannot show"
        case LimitationKind.ONE_SIDED:
            return f"one-sided torque: gravity loads {joints} to one side, so backlash cannot show there"
        case LimitationKind.ONE_LOAD:
            return "one load: stiffness, backlash and mass look alike"


def rows_in_order_of(limitation: Limitation, effects: str) -> str:
    """That rows without a time follow a joint, and what that means for `effects`."""
    joints = _joints(limitation.joints)
    return (
        f"the rows follow {joints} (correlation {limitation.numbers[0]:.2f}) and have no t_s, so errors of time and of "
        f"{joints} look alike. If the table was sorted, {effects} may be wrong: state t_s, or keep the order measured"
    )


def rounding_words(step_deg: float, tip: float) -> str:
    """What angles in steps (deg) would cost the tip (m), if the servos got finer ones."""
    return (
        f"all joint angles lie multiples of {step_deg:g} deg apart. If the servos got finer ones, that explains the "
        f"error: it alone makes {in_mm(tip)} mm RMS. Write the angles as they were sent"
    )


def paced_words(pace_s: float) -> str:
    """What times mean where none were measured."""
    return f"without t_s, poses count as {pace_s:g} s apart: times and time constants are not known"


def _joints(numbers: Sequence[int]) -> str:
    names = list(map(str, numbers))
    if len(names) > 2 and len(names) == numbers[-1] - numbers[0] + 1:
        return f"joints {names[0]} to {names[-1]}"
    return f"joint {''.join(names)}" if len(names) < 2 else f"joints {', '.join(names[:-1])} and {names[-1]}"


def where_measured(parts: Sequence[MeasuredAngles]) -> str:
    """Where a verdict holds; empty where the poses cover the arm's range."""
    words = [
        f"joint {measured_joint.joint} at {', '.join(f'{level:g}' for level in measured_joint.levels)} deg only"
        if measured_joint.levels
        else f"joint {measured_joint.joint} from {measured_joint.least:.0f} to {measured_joint.most:.0f} deg"
        for measured_joint in parts
    ]
    return f"only where it was measured: {'; '.join(words)}" if words else ""
