"""Figure of `diagnose`: errors that candidates would leave, the evidence for the first, its form beside the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.data.wording import in_mm
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, TITLE_LINE, figure_file, finish, legend_below
from lrm_ident.residual.covariates import SYMBOLS, covariates, symbol_words
from lrm_ident.residual.free_functions import FreeFunction
from lrm_math.arm.place_names import place_words
from lrm_math.arrays import Array
from lrm_math.effects import Effect, LoadedJointEffect
from lrm_math.effects.base import Amounts
from lrm_math.effects.derivatives import by_angles, by_parameters
from lrm_math.effects.targets import SERVO, slot_of
from lrm_math.kinematics.chain import is_zero
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import respond

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DRAWN = 9
EVIDENCE = {
    Support.SUPPORTED: "improves the prediction",
    Support.INDISTINGUISHABLE: "indistinguishable from others",
    Support.NO_EVIDENCE: "no evidence",
}
HATCH = {Support.SUPPORTED: "", Support.INDISTINGUISHABLE: "//", Support.NO_EVIDENCE: ".."}
BANDS = ((MODEL, "o"), (HELD_OUT, "^"), (GREEN, "s"))
GRID = 200
LEAST_LEVER = 0.3  # of the longest: shorter ones turn little motion of the TCP into large angles
DEGREES = 180.0 / np.pi


def draw_report(report: DiagnosisReport, path: Path | None) -> Figure:
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
    return figure


def _draw_ranking(axes: Axes, report: DiagnosisReport) -> None:
    shown = report.ranking[:DRAWN][::-1]
    names = [f"{plain_name(a.scored.name)}\n{a.scored.name}" for a in shown]
    bars = axes.barh(names, [a.held_out_rms * 1e3 for a in shown], color=MODEL)
    for bar, advice in zip(bars, shown, strict=True):
        bar.set_hatch(HATCH[advice.verdict])
        bar.set_edgecolor("white")
        bar.set_color(MODEL if advice.verdict != Support.NO_EVIDENCE else NOMINAL)
    axes.tick_params(axis="y", labelsize=8)
    axes.bar_label(bars, [f"{'' if a.exact else '≈ '}{in_mm(a.held_out_rms)}" for a in shown], padding=8)
    now, floor = report.held_out.rms * 1e3, report.diagnosis.floor.rms
    axes.axvline(now, color="black", linestyle="-", linewidth=1, label=f"now {now:.2f} mm")
    if floor is not None:
        axes.axvline(floor * 1e3, color="black", linestyle=":", linewidth=1.5, label=f"noise {floor * 1e3:.2f} mm")
    axes.set(xlabel="held-out RMS error with the effect added, mm", xlim=(0, 1.2 * now))
    verdicts = {advice.verdict for advice in shown}
    for verdict, words in EVIDENCE.items():
        if verdict in verdicts:
            colour = MODEL if verdict != Support.NO_EVIDENCE else NOMINAL
            axes.barh([-1], [0], color=colour, hatch=HATCH[verdict], edgecolor="white", label=words)
    axes.set_ylim(-0.6, len(shown) - 0.4)
    legend_below(axes, 2)
    title = conclude(report).headline if report.first is None else plain_name(report.first.scored.name)
    missing = title if report.first is None else f"Best candidate: {title}"
    axes.set_title(fill(missing, TITLE_LINE), fontsize=11)


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
    axes.plot([-most, most], [-most, most], color="black", linestyle="--", linewidth=1, label="all explained")
    name = plain_name(scored.name)
    finish(axes, f"motion that {name} would add, mm", "residual of the fit, mm", f"Added-variable plot: {name}")


def _draw_form(axes: Axes, curve: DriverCurve) -> None:
    """The turn of the joint against what drives it: the fitted form with its band, and what the poses show."""
    label = "poses: the effect and the residual"
    axes.scatter(curve.measured_at, curve.measured, s=10, color=NOMINAL, label=label)
    axes.plot(curve.at, curve.turn, color=MODEL, linewidth=2, label=" + ".join(map(plain_name, curve.effects)))
    low, high = curve.turn - 2.0 * curve.error, curve.turn + 2.0 * curve.error
    axes.fill_between(curve.at, low, high, color=MODEL, alpha=0.3, linewidth=0, label="two standard errors")
    driver, joint = symbol_words(curve.driver), place_words(curve.joint)
    title = f"The effect beside the data: {plain_name(curve.effects[-1])}"
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
    title = f"Structure of the residuals: {function.name}"
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
    torque = found.fit.equilibrium.joint_torque
    if name == "total torque":
        return np.asarray(np.abs(torque[found.screened]).sum(axis=1))
    if name == "order":
        return found.screened.astype(np.float64)
    known = {one.symbol: one for one in covariates(found.data, torque)}
    if name in known:
        return known[name].shown[found.screened]
    joint = int(name.partition(" ")[0].removeprefix("tau")) - 1
    return np.asarray(np.concatenate([torque[:1, joint], torque[:-1, joint]])[found.screened])


@dataclass(frozen=True, eq=False)
class DriverCurve:
    """Turn of a joint by the effects of a fitted model that follow one driver.

    Attributes:
        driver, unit: the driver's name (`q2`, `tau2`, `t`) and unit. joint: the name of the joint that is turned.
        effects: names of the effects that are summed.
        at: (G,), values of the driver. turn, error: (G,), turn of the joint there and its standard error (°).
        measured_at, measured: (M,), drivers and turns of the poses whose TCP is far enough from the joint's axis: the
            effects' own and what the residual acts like (°).
    """

    driver: str
    unit: str
    joint: str
    effects: tuple[str, ...]
    at: Array
    turn: Array
    error: Array
    measured_at: Array
    measured: Array


def driver_curve(fitted: Fit, effect: Effect) -> DriverCurve | None:
    """The curve of all effects of the model that turn the same joint by the same driver; None if there is no such."""
    driver, model, equilibrium = driver_of(effect), fitted.model, fitted.equilibrium
    if not driver or len(effect.targets) != 1 or not effect.targets[0].endswith((".theta", SERVO)):
        return None
    turned = slot_of(effect.targets[0])
    slot, load_row = model.chain.index[turned], {k: row for row, k in enumerate(model.load_slots)}
    torque = equilibrium.tau[load_row[slot]] if slot in load_row else np.zeros(len(equilibrium.poses))
    values = _driver_values(driver, equilibrium.poses, np.broadcast_to(np.asarray(torque), len(equilibrium.poses)))
    grid = np.linspace(values.min(), values.max(), GRID)
    alike = [(one, p) for one, p in model.parts() if driver_of(one) == driver and slot_of(one.targets[0]) == turned]
    lever = respond(equilibrium).slots[slot]
    square = (lever**2).sum(axis=0)
    far = square > LEAST_LEVER**2 * square.max()
    there = _poses_along(driver, equilibrium.poses, grid)
    own, turn, columns = np.zeros(len(values)), np.zeros(GRID), []
    keys: list[str] = []
    for one, p in alike:
        here, along = _felt(one, values), _felt(one, grid)
        own = own + np.asarray(one.amounts(equilibrium.poses, here, p)[0])
        turn = turn + np.asarray(one.amounts(there, along, p)[0])
        keys += one.keys
        for amounts in by_parameters(one, there, along, p):
            columns.append(np.broadcast_to(np.asarray(amounts[0]), GRID))
    measured = own + (fitted.residual.T * lever).sum(axis=0) / np.maximum(square, 1e-12)
    scale, unit = (DEGREES, "°") if driver.startswith("q") else (1.0, "N·m" if driver.startswith("tau") else "s")
    return DriverCurve(
        driver=driver,
        unit=unit,
        joint=effect.targets[0].partition(".")[0],
        effects=tuple(one.name for one, _ in alike),
        at=grid * scale,
        turn=turn * DEGREES,
        error=_standard_error(fitted, keys, columns) * DEGREES,
        measured_at=values[far] * scale,
        measured=measured[far] * DEGREES,
    )


def driver_of(effect: Effect) -> str:
    """The one quantity that an effect is a function of: `qN`, `tauN` or `t`; empty if there are several, or none."""
    if effect.depends_on == ("time",) and not effect.load_slots:
        return "t"
    if not effect.depends_on and isinstance(effect, LoadedJointEffect):
        return f"tau{effect.joint + 1}"
    if effect.depends_on != ("angle",) or effect.load_slots:
        return ""
    p = [parameter.default or parameter.typical for parameter in effect.parameters]
    rows = by_angles(effect, poses_of(np.full((2, effect.arm.dof), 0.3)), (), p)
    joints = [joint for joint, amounts in enumerate(rows, 1) if not all(map(is_zero, amounts))]
    return f"q{joints[0]}" if len(joints) == 1 else ""


def _driver_values(driver: str, poses: Poses, torque: Array) -> Array:
    if driver == "t":
        return np.zeros(len(poses)) if poses.t is None else poses.t
    return torque if driver.startswith("tau") else poses.q[:, int(driver[1:]) - 1]


def _poses_along(driver: str, poses: Poses, grid: Array) -> Poses:
    """The first pose again and again, with the driver at the values of the grid."""
    q = np.repeat(poses.q[:1], len(grid), axis=0)
    if driver.startswith("q"):
        q[:, int(driver[1:]) - 1] = grid
    return Poses(q, np.zeros(len(grid)), t=grid if driver == "t" else None)


def _felt(effect: Effect, torque: Array) -> Amounts:
    return (torque,) * len(effect.load_slots)


def _standard_error(fitted: Fit, keys: Sequence[str], columns: Sequence[Array]) -> Array:
    """(G,), of the sum of the columns (G,) times the parameters of these keys, as far as they are fitted."""
    row = {key: number for number, key in enumerate(fitted.model.free)}
    known = [(row[key], column) for key, column in zip(keys, columns, strict=True) if key in row]
    if not known:
        return np.zeros(GRID)
    rows, B = [number for number, _ in known], np.stack([column for _, column in known], axis=1)
    variance = np.einsum("gi,ij,gj->g", B, fitted.covariance[np.ix_(rows, rows)], B)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
