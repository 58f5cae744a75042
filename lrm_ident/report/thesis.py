"""The thesis's tables 6.1 to 6.8 on any data set: for people, for machines, and the rows behind every figure."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from lrm_ident.data.error_distribution import Distribution, distribution
from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.report.fit import screen_unit, table
from lrm_ident.thesis.thesis_options import Crossed, Identified, Method
from lrm_ident.thesis.thesis_results import NOMINAL, TABLE_6_8, Campaign, Printed
from lrm_math.arrays import Array

SHOWN = ("compliance.*", "offsets.base.z_mm")  # what the thesis prints in chapter 6
LABELS = {"option1_2": "option 1₂", "option3_2": "option 3₂"}


def label(option: str) -> str:
    """An option as the thesis writes it."""
    return LABELS.get(option, option.replace("option", "option "))


def print_method(console: Console, method: Method, beside: Campaign | None) -> None:
    """Parameters, errors over all poses, errors over the rest; with a campaign of the thesis beside them."""
    chosen, total = len(method.identified[0].rows), len(method.data)
    console.print(_parameters(method, beside))
    console.print(_errors(method, f"All {total} poses (thesis Tables 6.4, 6.6)", beside, rest=False))
    title = f"The {total - chosen} poses not among the {chosen} chosen ones (thesis Tables 6.5, 6.7)"
    console.print(_errors(method, title, beside, rest=True))
    console.print(_shapes(method))


def print_crossed(console: Console, crossed: Crossed, names: tuple[str, str], with_thesis: bool) -> None:
    """Table 6.8: each data set's parameters on both data sets, over the poses not chosen there."""
    columns = [f">{what} on {name}" for name in names for what in ("mean", "max")]
    thesis = [">thesis mean", ">thesis max"] * 2 if with_thesis else []
    out = table(
        f"Cross-load, {label(crossed.option.name)} (thesis Table 6.8), mm", "identified on", ">poses", *columns, *thesis
    )
    for i, name in enumerate(names):
        errors = [crossed.error(i, j) for j in range(2)]
        cells = [cell for error in errors for cell in (_mm(error.mean), _mm(error.max))]
        keys = [(("no-load", "loaded")[i], ("no-load", "loaded")[j]) for j in range(2)]
        printed = [f"{value:.2f}" for key in keys for value in TABLE_6_8[key]] if with_thesis else []
        out.add_row(name, str(len(crossed.both[i].rows)), *cells, *printed)
    console.print(out)


def _parameters(method: Method, beside: Campaign | None) -> Table:
    names = [one.option.name for one in method.identified]
    columns = (">" + label(name) for name in names)
    out = table("Identified parameters (thesis Tables 6.1 to 6.3; more with --json)", "", *columns, "unit")
    model = method.identified[0].fit.model
    for key in (key for pattern in SHOWN for key in model.keys if fnmatchcase(key, pattern)):
        scale, unit = screen_unit(model, key)
        fits = [one.fit.model for one in method.identified]
        cells = [f"{fitted.value(key) * scale:.3g}" if key in fitted.free else "" for fitted in fits]
        out.add_row(key.partition(".")[2].removesuffix("_" + model.parameters[model.position(key)].unit), *cells, unit)
        if beside:
            printed = [beside.parameters.get(name, {}).get(key) for name in names]
            out.add_row("  thesis", *("" if value is None else f"{value:.3g}" for value in printed), "", style="dim")
    return out


def _errors(method: Method, title: str, beside: Campaign | None, rest: bool) -> Table:
    thesis = [">thesis mean", ">max", ">SD"] if beside else []
    out = table(title, "", ">parameters", ">mean mm", ">max mm", ">SD mm", ">mean reduced by", *thesis)
    nominal = figures(method.nominal)
    printed = (beside.on_rest if rest else beside.on_all) if beside else {}
    out.add_row("nominal (all)", "0", *_three(nominal), "", *_printed(beside, printed.get(NOMINAL)))
    for one in method.identified:
        error = one.on_rest if rest else one.on_all
        base = figures(method.nominal[one.rest]) if rest else nominal
        cells = (*_three(error), f"{100 * (1 - error.mean / base.mean):.1f} %")
        out.add_row(
            label(one.option.name),
            str(len(one.fit.model.free)),
            *cells,
            *_printed(beside, printed.get(one.option.name)),
        )
    return out


def _shapes(method: Method) -> Table:
    out = table(
        "How the errors are distributed (rest), beside a Gaussian of the same mean and SD",
        "",
        ">median mm",
        ">90 % below",
        ">Gaussian says",
        ">skewness",
        ">A*",
        "Gaussian?",
    )
    for name, shape in shapes_of(method):
        says = shape.mean + 1.2816 * shape.sd
        verdict = "cannot be refused" if shape.is_gaussian else "no"
        cells = (_mm(shape.quantile(0.5)), _mm(shape.quantile(0.9)), _mm(says), f"{shape.skewness:+.2f}")
        out.add_row(label(name), *cells, f"{shape.misfit:.1f}", verdict)
    return out


def shapes_of(method: Method) -> Iterator[tuple[str, Distribution]]:
    """The nominal arm's errors over all poses, each option's over the rest."""
    yield NOMINAL, distribution(method.nominal)
    for one in method.identified:
        yield one.option.name, distribution(one.residual[one.rest])


def method_json(method: Method) -> dict[str, Any]:
    """One data set, schema `lrm/options/1`."""
    return {
        "data": method.data.path.name,
        "poses": len(method.data),
        "nominal": figures(method.nominal).as_json(),
        "options": [_identified_json(method, one) for one in method.identified],
    }


def _identified_json(method: Method, one: Identified) -> dict[str, Any]:
    model, shape = one.fit.model, distribution(one.residual[one.rest])
    return {
        "option": one.option.name,
        "bounded": one.option.physical,
        "chosen_poses": [int(number) for number in method.data.pose[one.rows]],
        "error": {
            "chosen": one.on_chosen.as_json(),
            "all": one.on_all.as_json(),
            "rest": one.on_rest.as_json(),
        },
        "estimates": {
            key: {
                "value": model.value(key) / model.parameters[model.position(key)].si,
                "se": float(error) / model.parameters[model.position(key)].si,
                "at_bound": key in one.fit.at_bound,
            }
            for key, error in zip(model.free, one.fit.standard_error, strict=True)
        },
        "distribution": {
            "skewness": shape.skewness,
            "anderson_darling": shape.misfit,
            "gaussian": shape.is_gaussian,
            "gaussian_below_zero": shape.below_zero,
        },
    }


def crossed_json(crossed: Crossed, names: tuple[str, str]) -> list[dict[str, Any]]:
    """Table 6.8 for machines."""
    return [
        {
            "option": crossed.option.name,
            "identified_on": names[i],
            "measured_on": names[j],
            "error": crossed.error(i, j).as_json(),
        }
        for i in range(2)
        for j in range(2)
    ]


def error_rows(method: Method) -> str:
    """The data behind the figure of one data set: CSV, one row per pose, one column per option (mm)."""
    columns: list[tuple[str, Array]] = [(NOMINAL, method.nominal)]
    columns += [(one.option.name, one.residual) for one in method.identified]
    head = ["pose", *(f"{name}_mm" for name, _ in columns), *(f"{one.option.name}_chosen" for one in method.identified)]
    errors = np.stack([np.linalg.norm(residual, axis=1) * 1e3 for _, residual in columns], axis=1)
    chosen = np.stack([~one.rest for one in method.identified], axis=1).astype(int)
    lines = [
        ",".join([str(pose), *(f"{value:.4f}" for value in row), *map(str, marks)])
        for pose, row, marks in zip(method.data.pose, errors, chosen, strict=True)
    ]
    return "\n".join([",".join(head), *lines]) + "\n"


def crossed_rows(crossed: Crossed, names: tuple[str, str]) -> str:
    """The data behind the cross-load figure: CSV, one row per pose and data set, a column per parameter set (mm)."""
    lines = [f"measured_on,row,chosen_there,{names[0]}_mm,{names[1]}_mm"]
    for j, name in enumerate(names):
        own, other = (np.linalg.norm(crossed.residual[i][j], axis=1) * 1e3 for i in range(2))
        chosen = ~crossed.both[j].rest
        lines += [f"{name},{row},{int(chosen[row])},{own[row]:.4f},{other[row]:.4f}" for row in range(len(own))]
    return "\n".join(lines) + "\n"


def _three(error: ErrorFigures) -> tuple[str, str, str]:
    return _mm(error.mean), _mm(error.max), _mm(error.sd)


def _printed(beside: Campaign | None, printed: Printed | None) -> tuple[str, ...]:
    if beside is None:
        return ()
    if printed is None:
        return "", "", ""
    return f"{printed.mean_mm:.2f}", f"{printed.max_mm:.1f}", f"{printed.sd_mm:.2f}"


def _mm(metres: float) -> str:
    return f"{metres * 1e3:.2f}"
