"""Figure of `diagnose`: the error that each candidate would leave, and the evidence for the first one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.report.plain_names import in_words, plain_name
from lrm_ident.report.plots.driver_curve import DriverCurve, driver_curve
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, figure_file, finish
from lrm_ident.residual.covariates import SYMBOLS, covariates
from lrm_ident.residual.free_functions import FreeFunction
from lrm_math.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DRAWN = 9
HATCH = {"supported": "", "indistinguishable": "//", "no_evidence": ".."}
BANDS = ((MODEL, "o"), (HELD_OUT, "^"), (GREEN, "s"))


def draw_report(report: DiagnosisReport, path: Path) -> None:
    """Draws a diagnosis. Raises `FileError` for an unknown format or a place that cannot be written."""
    first = report.first
    curve = None if first is None or first.fit is None else driver_curve(first.fit, first.scored.candidate.effect)
    with figure_file(path, 13 if curve is None else 19, 4.6) as figure:
        panels = figure.subplots(1, 2 if curve is None else 3)
        left, right = panels[:2]
        _draw_ranking(left, report)
        if curve is not None:
            _draw_form(panels[2], curve)
        if first is not None:
            _draw_evidence(right, report.diagnosis, first)
        elif report.diagnosis.unexplained.ranking:
            _draw_anatomy(right, report.diagnosis, report.diagnosis.unexplained.ranking[0][0])


def _draw_ranking(axes: Axes, report: DiagnosisReport) -> None:
    shown = report.ranking[:DRAWN][::-1]
    names = [f"{plain_name(a.scored.name)}\n{a.scored.name}" for a in shown]
    bars = axes.barh(names, [a.held_out_rms * 1e3 for a in shown], color=MODEL)
    for bar, advice in zip(bars, shown, strict=True):
        bar.set_hatch(HATCH[advice.verdict])
        bar.set_edgecolor("white")
        bar.set_color(MODEL if advice.verdict != "no_evidence" else NOMINAL)
    axes.tick_params(axis="y", labelsize=8)
    axes.bar_label(bars, [f"{'' if a.exact else '≈ '}{in_mm(a.held_out_rms)}" for a in shown], padding=8)
    now, floor = report.held_out.rms * 1e3, report.diagnosis.floor.rms
    axes.axvline(now, color="black", linestyle="-", linewidth=1)
    noise = ""
    if floor is not None:
        axes.axvline(floor * 1e3, color="black", linestyle=":", linewidth=1.5)
        noise = f", dots: noise {floor * 1e3:.2f}"
    axes.set(xlabel="held-out RMS that it would leave, mm", xlim=(0, 1.2 * now))
    axes.set_title(f"{report.verdict.replace('_', ' ')} (line: now {now:.2f}{noise} mm)", fontsize=10)


def _draw_evidence(axes: Axes, found: Diagnosis, first: RankedCandidate) -> None:
    """Added-variable plot: what the fit leaves, against what the effect would add beyond the fitted parameters.

    One point for each pose and axis; along the dashed line the effect explains all of it.
    """
    scored = first.scored
    fitted, data = found.screened_subset
    motion = RowWeights(data.whitening, fitted.weight).positions(scored.added) * 1e3
    residual = fitted.residual * 1e3
    for axis, (colour, marker) in enumerate(BANDS):
        label = f"along {'xyz'[axis]}"
        axes.scatter(motion[:, axis], residual[:, axis], s=12, color=colour, marker=marker, label=label)
    most = float(np.abs(motion).max())
    axes.plot([-most, most], [-most, most], color="black", linestyle="--", linewidth=1, label="as the effect says")
    name = plain_name(scored.name)
    finish(axes, f"what {name} would add beyond the fit, mm", "what the fit leaves, mm", f"The evidence: {name}")


def _draw_form(axes: Axes, curve: DriverCurve) -> None:
    """The turn of the joint against what drives it: the fitted form with its band, and what the poses show."""
    label = "each pose: the form and what the fit leaves"
    axes.scatter(curve.measured_at, curve.measured, s=10, color=NOMINAL, label=label)
    axes.plot(curve.at, curve.turn, color=MODEL, linewidth=2, label=" + ".join(map(plain_name, curve.effects)))
    low, high = curve.turn - 2.0 * curve.error, curve.turn + 2.0 * curve.error
    axes.fill_between(curve.at, low, high, color=MODEL, alpha=0.3, linewidth=0, label="two standard errors")
    driver, joint = in_words(curve.driver), in_words(curve.joint)
    title = f"The form: {plain_name(curve.effects[-1])}"
    finish(axes, f"{driver}, {curve.unit}", f"turn of {joint}, °", title)


def _draw_anatomy(axes: Axes, found: Diagnosis, function: FreeFunction) -> None:
    """The motion that each residual acts like, against what it follows; a second quantity in three bands."""
    shift = function.shift
    motion = function.terms[0][0][:3] if shift is None else shift.direction
    length = np.maximum((motion**2).sum(axis=0), 1e-12)
    scale, acts_like = _motion_shown(function)
    amount = scale * (found.fit.residual[found.screened].T * motion).sum(axis=0) / length
    name = _with_unit(function.covariates[0]) if shift is None else f"{function.covariates[0]}, N"
    values = _values(found, function.covariates[0]) if shift is None else shift.force
    if len(function.covariates) == 1:
        axes.scatter(values, amount, s=12, color=MODEL)
    else:
        second, other = function.covariates[1], _values(found, function.covariates[1])
        edges = np.quantile(other, [0, 1 / 3, 2 / 3, 1])
        for (colour, marker), low, high in zip(BANDS, edges, edges[1:], strict=False):
            band = (other >= low) & (other <= high)
            label = f"{_with_unit(second)} from {low:.3g} to {high:.3g}"
            axes.scatter(values[band], amount[band], s=14, color=colour, marker=marker, label=label)
    limit = float(np.quantile(np.abs(amount), 0.98))
    axes.set_ylim(-1.3 * limit, 1.3 * limit)
    title = f"Anatomy: {in_words(function.name)}"
    finish(axes, name, f"acts like a {acts_like}", title, legend=len(function.covariates) > 1)


def _motion_shown(function: FreeFunction) -> tuple[float, str]:
    """Factor to the unit that is shown, and the motion in words with that unit."""
    if function.shift is not None:
        return 1e3, f"shift of {function.place} along that force, mm"
    if function.joint is not None:
        return float(np.degrees(1.0)), f"turn of {function.place}, deg"
    if "yielding" in function.place:
        return 1.0, f"change of {function.place}, rad/N·m"
    return 100.0, f"change of {function.place}, %"


def _with_unit(name: str) -> str:
    units = {"order": "", "load": "g", "time": "min", "temperature": "°C"}
    unit = units.get(name, "deg" if name.startswith(("q", SYMBOLS["motion"])) else "N·m")
    return f"{name}, {unit}" if unit else name


def _values(found: Diagnosis, name: str) -> Array:
    """(N,), a covariate at the poses that were screened as shown; at the pose before, of all that were measured."""
    torque = found.fit.rest.joint_torque
    if name == "total torque":
        return np.asarray(np.abs(torque[found.screened]).sum(axis=1))
    if name == "order":
        return found.screened.astype(np.float64)
    known = {one.symbol: one for one in covariates(found.data, torque)}
    if name in known:
        return known[name].shown[found.screened]
    joint = int(name.partition(" ")[0].removeprefix("tau")) - 1
    return np.asarray(np.concatenate([torque[:1, joint], torque[:-1, joint]])[found.screened])
