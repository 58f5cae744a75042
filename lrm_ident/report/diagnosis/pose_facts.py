"""Facts on the poses: which count or are far off, what their order leaves open, and where the verdict holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.wording import enumerate_words, in_mm, poses_count
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.plain_names import enumerate_effects
from lrm_ident.report.text.poses import paced_words, rows_in_order_of
from lrm_ident.report.text.residuals import A_LENGTH, WHY_OFF
from lrm_ident.residual.data_audit import LimitationKind, MeasuredAngles, where_it_holds
from lrm_ident.residual.scale_uncertainty import distance_from_centre, scale_uncertainty
from lrm_math.arm.arm import JointLimits
from lrm_math.arm.place_names import joint_numbers
from lrm_math.effects import Effect
from lrm_math.kinematics.history import PACE_S

POSES_SHOWN, NAMED = 8, 2
ORDERED = frozenset({"direction", "time", "session"})
"""What an effect depends on if the order of the poses decides it."""


def left_out(diagnosis: Diagnosis) -> str:
    """The outliers that no figure counts: how many, how far off, and what they may be; empty where there are none."""
    outliers = diagnosis.outliers
    if not outliers:
        return ""
    distances = [diagnosis.outlier_distances[number] for number in outliers if number in diagnosis.outlier_distances]
    far = f", up to {in_mm(max(distances))} mm off" if distances else ""
    count = f"{len(outliers)} of {poses_count(len(diagnosis.data) + len(outliers))}"
    return f"{count}, as outliers{far}: {enumerate_words(list(map(str, outliers)), POSES_SHOWN)}. {WHY_OFF}"


def far_poses(report: DiagnosisReport) -> Iterator[str]:
    """The few poses that hold most of the error, if the others show much less."""
    rows = report.far_rows
    if not rows:
        return
    fit, data, floor = report.diagnosis.fit, report.diagnosis.data, report.diagnosis.floor.sd
    distance = np.linalg.norm(fit.residual, axis=1)
    poses = enumerate_words([f"{data.pose[row]} ({in_mm(distance[row])} mm)" for row in rows], POSES_SHOWN)
    others = np.delete(distance, rows)
    sigma = fit.sigma * np.sqrt((others @ others) / (distance @ distance))
    noise = "" if floor is None else f", {sigma / floor:.2f} times the noise"
    which = "pose" if len(rows) == 1 else "poses"
    yield (
        f"{which} {poses}; the others have {in_mm(float(np.sqrt(np.mean(others**2))))} mm RMS{noise}. Measure there "
        "again and nearby: either these measurements are wrong, or the missing effect shows only there."
    )
    side = data.poses.direction
    directed = any("direction" in effect.depends_on for effect in fit.model.effects)
    if directed and side is not None and (blind := [str(data.pose[row]) for row in rows if not side[row].any()]):
        yield (
            f"The direction of approach of pose {enumerate_words(blind, POSES_SHOWN)} is not known, and the model "
            "needs it: state start_q_deg in the file beside the data, or the columns approach."
        )


def order(assessment: Assessment) -> str:
    """What rows without a time leave open, where an effect depends on the order of the poses or on a joint that the
    order follows."""
    report, first = assessment.report, assessment.first
    if report.diagnosis.data.poses.t is not None:
        return ""
    effects = [*assessment.causes.values(), *([] if first is None else [first.effect])]
    timed = any(effect.remembers or "time" in effect.depends_on for effect in effects)
    return "; ".join(filter(None, (_follows_joint(report, effects), paced_words(PACE_S) if timed else "")))


def _follows_joint(report: DiagnosisReport, effects: Sequence[Effect]) -> str:
    """That the order of the rows may not be that of the measurement."""
    follows = [limitation for limitation in report.limitations if limitation.kind is LimitationKind.ORDER]
    joints = {joint - 1 for limitation in follows for joint in limitation.joints}
    concerned = [
        effect.name
        for effect in effects
        if effect.remembers or not ORDERED.isdisjoint(effect.depends_on) or joints & {*joint_numbers(effect.place)}
    ]
    return rows_in_order_of(follows[0], enumerate_effects(concerned, NAMED)) if follows and concerned else ""


def valid_where(report: DiagnosisReport) -> tuple[MeasuredAngles, ...]:
    """Angles and ranges at which the verdict holds alone; empty where the poses cover the arm's range."""
    limits = JointLimits.of(report.diagnosis.fit.model.arm)
    return where_it_holds(report.diagnosis.data.poses.q, np.array(limits.lower), np.array(limits.upper))


def not_tested(report: DiagnosisReport) -> str:
    """The scale of a tracker that is taken as right: what a wrong one would cost, and what decides; empty otherwise."""
    data, fit = report.diagnosis.data, report.diagnosis.fit
    decided = data.of(Distances) or data.touched or not data.positions.measured.any()
    if decided or scale_uncertainty(fit) is not None:
        return ""
    return f"the tracker's scale (1 mm/m costs {in_mm(1e-3 * distance_from_centre(fit))} mm at the tip). {A_LENGTH}"
