"""What people read: tables for the terminal. Every picture of size is also a number."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.table import Table

from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.error_breakdown import Comparison, Factor, HeldOut
from lrm_ident.fit.identifiability import Unidentifiable
from lrm_ident.fit.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from lrm_math.model.model import Model

BAR, FACTORS_SHOWN, PARTS_SHOWN, STRONG = 10, 8, 3, 0.95
PRETTY_UNIT = {"rad_per_Nm": "rad/Nm", "Nm_per_rad": "Nm/rad", "rad": "deg"}


def table(title: str, *columns: str) -> Table:
    """An empty table; columns whose name starts with ">" stand on the right."""
    out = Table(title=title, title_justify="left", box=SIMPLE_HEAD, title_style="bold", pad_edge=False)
    for name in columns:
        out.add_column(name.removeprefix(">"), justify="right" if name.startswith(">") else "left")
    return out


def error_table(nominal: ErrorFigures, fitted: ErrorFigures, held_out: HeldOut, title: str) -> RenderableType:
    """Nominal, fit and held-out error side by side."""
    errors = table(title, "TCP error, mm", ">mean", ">RMS", ">max", ">SD")
    errors.add_row("nominal arm", *_mm(nominal))
    errors.add_row("model", *_mm(fitted))
    if held_out.error is None:
        return Group(errors, f"held out: none, because {held_out.reason}")
    errors.add_row("held out (10 joint-space blocks)", *_mm(held_out.error))
    return errors


def parameter_table(fit: Fit) -> Table:
    """Estimates with standard errors; angles in degrees."""
    out = table(f"{len(fit.model.free)} parameters", "parameter", ">value", ">± standard error", "unit")
    for key, error in zip(fit.model.free, fit.standard_error, strict=True):
        scale, unit = screen_unit(fit.model, key)
        note = "at its bound" if key in fit.at_bound else f"± {error * scale:.4f}"
        name = key.removesuffix("_" + fit.model.parameters[fit.model.position(key)].unit)
        out.add_row(name, f"{fit.model.value(key) * scale:.4f}", note, unit)
    return out


def held_lines(model: Model, held: tuple[Unidentifiable, ...]) -> Iterator[str]:
    """One line for every parameter that the data cannot tell."""
    for parameter in held:
        yield f"  {parameter.key}: {_why(model, parameter)}"


def _why(model: Model, parameter: Unidentifiable) -> str:
    if not parameter.combination or parameter.survival > 0.2:
        scale, unit = screen_unit(model, parameter.key)
        return f"hardly moves the TCP (it would be known to ± {parameter.standard_error * scale:.3g} {unit})"
    unit = model.parameters[model.position(parameter.key)].unit
    parts = " and ".join(
        f"{amount:+.4g} {model.parameters[model.position(key)].unit} of {key}"
        for key, amount in parameter.combination[:PARTS_SHOWN]
    ) + (" and less of others" if len(parameter.combination) > PARTS_SHOWN else "")
    like = "exactly" if parameter.survival < 1e-6 else "nearly"
    return f"1 {unit} of it moves the TCP {like} like {parts}"


def correlation_lines(fit: Fit) -> Iterator[str]:
    """Pairs of parameters that the data can hardly tell apart."""
    correlation = fit.correlation
    for i in range(len(correlation)):
        for j in range(i):
            if abs(correlation[i, j]) > STRONG:
                yield f"  {fit.model.free[j]} and {fit.model.free[i]}: {correlation[i, j]:+.3f}"


def print_fit(
    console: Console,
    fit: Fit,
    held: tuple[Unidentifiable, ...],
    nominal: ErrorFigures,
    held_out: HeldOut,
    data: Measurements,
) -> None:
    """The result of `lrm-ident fit`."""
    fitted = figures(fit.residual)
    console.print(parameter_table(fit))
    _print_list(console, "Held at zero, because these poses cannot tell them:", held_lines(fit.model, held))
    _print_list(console, f"Correlated above {STRONG}:", correlation_lines(fit))
    outliers = (f"  pose {data.pose[row]}: {np.linalg.norm(fit.residual[row]) * 1e3:.1f} mm" for row in fit.outliers)
    _print_list(
        console,
        "Outliers (beyond 5 robust standard deviations): wrong measurements, or where the model fails most:",
        outliers,
    )
    console.print(error_table(nominal, fitted, held_out, f"{len(data)} poses, {len(fit.model.free)} parameters"))
    console.print(
        f"The mean error fell from {nominal.mean * 1e3:.2f} to {fitted.mean * 1e3:.2f} mm "
        f"({100 * (1 - fitted.mean / nominal.mean):.0f} % less)"
        + ("." if held_out.error is None else f"; on poses it never saw it is {held_out.error.mean * 1e3:.2f} mm.")
    )


def print_comparison(console: Console, comparison: Comparison, data: Measurements) -> None:
    """The result of `lrm-ident compare`."""
    free = len(comparison.rest.model.free)
    title = f"{len(data)} poses, {free} parameters"
    console.print(error_table(comparison.nominal, comparison.error, comparison.held_out, title))
    console.print(_factor_table(comparison))
    for factor in comparison.factors[:2]:
        console.print(_group_table(factor))
    console.print(_worst_table(comparison, data))


def _factor_table(comparison: Comparison) -> Table:
    out = table(
        "Where it fails: what the residual follows", "split by", ">explains", "", "worst group", ">RMS mm", ">poses"
    )
    for factor in comparison.factors[:FACTORS_SHOWN]:
        worst, share = factor.worst, factor.share
        bar = "█" * round(BAR * share)
        out.add_row(
            factor.name, f"{100 * share:.0f} %", bar, worst.label, f"{worst.error.rms * 1e3:.2f}", str(worst.count)
        )
    return out


def _group_table(factor: Factor) -> Table:
    turns = factor.groups[0].acts_like is not None
    acts_like = [f">like q{factor.name.split()[-1]} deg"] if turns else []
    out = table(f"By {factor.name}", "group", ">poses", ">mean", ">RMS mm", ">mean residual mm", *acts_like)
    for group in factor.groups:
        mean, rms, *_ = _mm(group.error)
        turn = [] if group.acts_like is None else [f"{np.degrees(group.acts_like):+.2f}"]
        out.add_row(group.label, str(group.count), mean, rms, _vector(np.array(group.bias)), *turn)
    return out


def _worst_table(comparison: Comparison, data: Measurements) -> Table:
    angles = ">" + " ".join(f"{'q' + str(i + 1):>4s}" for i in range(data.poses.q.shape[1]))
    out = table("The worst poses (angles in deg)", ">pose", angles, ">load g", ">error mm", ">residual mm")
    for row in comparison.worst:
        q = " ".join(f"{angle:4.0f}" for angle in np.degrees(data.poses.q[row]))
        error = f"{np.linalg.norm(comparison.residual[row]) * 1e3:.2f}"
        load = f"{data.poses.payload[row] * 1e3:.1f}"
        out.add_row(str(data.pose[row]), q + "    ", load, error, _vector(comparison.residual[row]))
    return out


def _vector(metres: Array) -> str:
    return " ".join(f"{component * 1e3:+6.2f}" for component in metres)


def _print_list(console: Console, title: str, lines: Iterator[str]) -> None:
    found = list(lines)
    if found:
        console.print(title, style="bold")
        for line in found:
            console.print(line, highlight=False, soft_wrap=True)


def _mm(error: ErrorFigures) -> tuple[str, str, str, str]:
    return (f"{error.mean * 1e3:.2f}", f"{error.rms * 1e3:.2f}", f"{error.max * 1e3:.2f}", f"{error.sd * 1e3:.2f}")


def screen_unit(model: Model, key: str) -> tuple[float, str]:
    """What to multiply an SI value by for the screen, and the unit to print."""
    parameter = model.parameters[model.position(key)]
    if parameter.unit == "rad":
        return float(np.degrees(1.0)), "deg"
    return 1.0 / parameter.si, PRETTY_UNIT.get(parameter.unit, parameter.unit)
