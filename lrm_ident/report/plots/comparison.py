"""Figure of `compare`: error distributions, what the residual depends on, and its mean by group."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.report.plots.style import GREEN, HELD_OUT, MODEL, NOMINAL, figure_file, legend_below, plain_number
from lrm_ident.report.text.variables import variable_name
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import solve_equilibrium

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FACTORS_DRAWN, GROUPS_DRAWN = 8, 10


def draw_comparison(comparison: ModelComparison, path: Path | None) -> Figure:
    """Draws how far the error fell and what the rest follows. Raises `FileError` for an unknown format or place."""
    with figure_file(path, 13, 4.2) as figure:
        left, middle, right = figure.subplots(1, 3, width_ratios=(1.2, 1, 1.3))
        _draw_distribution(left, comparison)
        _draw_factors(middle, comparison)
        _draw_groups(right, comparison)
    return figure


def _draw_distribution(axes: Axes, comparison: ModelComparison) -> None:
    data = comparison.data
    nominal = solve_equilibrium(nominal_arm(comparison.equilibrium.model.arm, data), data.poses)
    _cumulative(axes, data.position_error(nominal), "nominal arm", NOMINAL, ":")
    _cumulative(axes, comparison.residual, "model, as fitted", MODEL, "-")
    if comparison.held_out.residual is not None:
        _cumulative(axes, comparison.held_out.residual, "model, held out", HELD_OUT, "--")
    title, below = f"How large the errors are ({len(data)} poses)", "share of the poses below it, %"
    axes.set(xlabel="TCP error, mm", ylabel=below, title=title, xscale="log", ylim=(0, 103), yticks=range(0, 101, 20))
    axes.xaxis.set_major_formatter(plain_number)
    axes.grid(which="both")
    legend_below(axes)


def _cumulative(axes: Axes, residual: Array, label: str, colour: str, line: str) -> None:
    distance = np.sort(np.linalg.norm(residual, axis=1)) * 1e3
    share = 100 * np.arange(1, len(distance) + 1) / len(distance)
    text = f"{label}: mean {distance.mean():.2f} mm"
    axes.plot(distance, share, color=colour, linestyle=line, linewidth=2, label=text)


def _draw_factors(axes: Axes, comparison: ModelComparison) -> None:
    factors = comparison.factors[:FACTORS_DRAWN][::-1]
    share = [100 * factor.share for factor in factors]
    axes.bar_label(
        axes.barh([variable_name(factor.variable) for factor in factors], share, color=MODEL), fmt="%.0f %%", padding=3
    )
    axes.set(xlabel="share of the residual that it explains, %", title="What the remaining error depends on")
    axes.set_xlim(0, max(max(share) * 1.25, 5))


def _draw_groups(axes: Axes, comparison: ModelComparison) -> None:
    factor = comparison.factors[0]
    groups, title = factor.groups[:GROUPS_DRAWN], f"Mean error by {variable_name(factor.variable)}"
    place = np.arange(len(groups))
    rotations = [group.equivalent_rotation for group in groups if group.equivalent_rotation is not None]
    if rotations:
        bars = axes.bar(place, np.degrees(rotations), 0.6, color=MODEL)
        words = [f"{group.error.rms * 1e3:.2g} mm\n{group.count}" for group in groups]
        axes.bar_label(bars, words, padding=3, fontsize=8)
        axes.margins(y=0.22)
        title += "\n(at each bar: RMS error, poses)"
        axes.set_ylabel(f"acts like a turn of joint {(factor.variable.joint or 0) + 1}, deg")
    else:
        for k, (hatch, colour) in enumerate((("", MODEL), ("//", HELD_OUT), ("..", GREEN))):
            bias = [group.bias[k] * 1e3 for group in groups]
            axes.bar(place + 0.27 * (k - 1), bias, 0.27, label="xyz"[k], hatch=hatch, color=colour, edgecolor="white")
        axes.set_ylabel("mean residual, mm")
        axes.legend(title="along")
    axes.set_xticks(place, [group.label for group in groups], rotation=35, ha="right")
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set_title(title)
