"""Facts on the error: how large it is beside the noise, in the session and on the arm, and what it may hide."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.wording import UNSEEN, arrow, between_words, in_mm
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.story import BY_THE_TRACKER, ON_THE_ARM
from lrm_ident.report.text.poses import rounding_words
from lrm_ident.report.text.residuals import BLACK_BOX
from lrm_ident.residual.rounded_commands import rounded_commands
from lrm_math.effects.targets import FRAME_PLACE

THE_REST = "the rest is noise"


def held_out_error(assessment: Assessment) -> str:
    """The error at unseen poses, beside the noise; with the cause, where one is to be added."""
    report, cause = assessment.report, assessment.cause
    floor, error = report.diagnosis.floor, report.held_out.rms
    if cause is not None:
        return f"{arrow(error, cause.held_out_rms)} mm RMS with it, at unseen poses ({_noise(report, '')})"
    if bounds_noise(report):
        reached = in_mm(report.patterns.predictable.error.rms)
        return f"{in_mm(error)} mm RMS {UNSEEN}, systematic: {BLACK_BOX} reaches {reached} mm"
    noise = _noise(report, "measurement ")
    if report.verdict == Verdict.UNPREDICTABLE and floor.sd is not None:
        noise += f": the error is {report.diagnosis.fit.sigma / floor.sd:.2f} times as large"
    elif report.verdict == Verdict.NOTHING_MISSING and floor.rms is not None:
        interval = floor.interval
        repeats = "" if interval is None else "; by repeated poses between {} and {} mm".format(*map(in_mm, interval))
        noise = f"{error / floor.rms:.1f} times the {noise}{repeats}"
    return f"{in_mm(error)} mm RMS {UNSEEN} ({noise})"


def _noise(report: DiagnosisReport, of: str) -> str:
    """The noise, or what it is at most where it is not known. `of`: what it is the noise of."""
    if report.diagnosis.floor.rms is None:
        return f"noise at most {in_mm(report.patterns.predictable.noise_bound)} mm"
    return f"{of}noise {in_mm(report.diagnosis.floor.rms)} mm"


def bounds_noise(report: DiagnosisReport) -> bool:
    """Whether nothing but the black-box model tells how small the noise is at most."""
    return report.diagnosis.floor.rms is None and report.patterns.predictable.more_to_find


def deployed_error(report: DiagnosisReport) -> str:
    """The error as deployed, where it is another than in the session."""
    deployed, shown, first = report.deployed, report.held_out.rms, report.first
    if first is not None and first.deployed is not None:
        after, fewer = in_mm(first.deployed.now.rms), first.deployed.fewer
        if first.deployed.among_measured is not None:
            return f"{after} mm RMS with it at later poses, as the arm goes on changing"
        if deployed.among_measured is not None:
            return f"{after} mm RMS with it, {_where_expected(report)}"
        before = in_mm((first.deployed_without or deployed.now).rms)
        same = (before, after) == (in_mm(shown), in_mm(first.held_out_rms))
        part = "" if fewer is None else f"at the {fewer} poses where its state held, "
        return "" if same else f"{before} → {after} mm RMS {part}{_where_expected(report)}"
    if deployed.among_measured is not None:
        among = f"{in_mm(deployed.among_measured.rms)} mm among the measured poses"
        return f"{in_mm(deployed.now.rms)} mm RMS at later poses ({among}), as the arm goes on changing"
    error = deployed.now
    between = between_words(error)
    interval = f" (at other poses {between}, 95 %)" if between else ""
    size = f"{in_mm(error.rms)} mm RMS{interval}, largest {in_mm(error.max)} mm{_without_noise(report)}"
    if in_mm(deployed.now.rms) == in_mm(shown) and deployed.otherwise is None:
        return size
    earlier = "" if deployed.otherwise is None else f" (earlier in this session {in_mm(deployed.otherwise.rms)} mm)"
    return f"{size}; {_where_expected(report)}{earlier}"


def _without_noise(report: DiagnosisReport) -> str:
    """How much of an error as deployed is the tip's own, where the noise is known and the tracker errs by no more."""
    if _where_expected(report) == BY_THE_TRACKER:
        return ""
    diagnosis, error = report.diagnosis, report.deployed.now.rms
    bounds = diagnosis.floor.error_without(error, report.deployed.fewer or len(diagnosis.data))
    if bounds is None or diagnosis.floor.rms is None or diagnosis.data.several_kinds:
        return ""
    if bounds[0]:
        error_without_noise = float(np.sqrt(error**2 - diagnosis.floor.rms**2))
        return f"; the tip itself ≈ {in_mm(error_without_noise)} mm, {THE_REST}"
    return f"; the tip itself ≤ {in_mm(bounds[1])} mm (95 %), {THE_REST}" if bounds[1] else ""


def _where_expected(report: DiagnosisReport) -> str:
    """What an error as deployed is of: a tracker that errs sees its own error, left out of the arm, there too."""
    first = report.first
    effects = [*report.diagnosis.fit.model.effects, *([] if first is None else [first.effect])]
    return BY_THE_TRACKER if any(effect.place == FRAME_PLACE for effect in effects) else ON_THE_ARM


def rounding(report: DiagnosisReport) -> str:
    """That an error that nothing predicts is as large as the rounding of the angles would make it."""
    diagnosis = report.diagnosis
    if report.verdict not in (Verdict.UNPREDICTABLE, Verdict.NOISE_UNKNOWN):
        return ""
    rounded = rounded_commands(diagnosis.data.poses.q, diagnosis.joint_jacobian)
    if rounded is None or not rounded.explains(report.held_out.rms, diagnosis.floor.rms or 0.0):
        return ""
    return rounding_words(np.degrees(rounded.step), rounded.tip)


def may_hide(report: DiagnosisReport) -> str:
    """How far a known effect may move the TCP without being shown."""
    bounds = report.diagnosis.motion_bounds
    if not bounds or report.diagnosis.data.several_kinds:
        return ""
    most = in_mm(max(bounds.values()))
    return f"{most} mm RMS at the tip, by one further known effect (95 %)"
