"""Report of `options`: the thesis's Tables 6.1 to 6.8 on any data set, and the numbers behind its figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.report.document import Block, Document, ResultTable
from lrm_ident.report.fit import estimates, screen_unit
from lrm_math.arrays import Array
from validation.thesis.error_distribution import ErrorDistribution, error_distribution, norms_mm
from validation.thesis.thesis_options import CrossLoadResult, OptionResult, OptionStudy
from validation.thesis.thesis_results import NOMINAL, TABLE_6_8, Campaign, PublishedError

SHOWN = ("compliance.*", "offsets.base.z_mm")  # what the thesis prints in chapter 6
LABELS = {"option1_2": "option 1₂", "option3_2": "option 3₂"}
LOADS = ("no-load", "loaded")
GAUSSIAN_90 = 1.2816  # standard deviations above the mean that 90 % of a Gaussian lie below


def label(option: str) -> str:
    """An option as the thesis writes it."""
    return LABELS.get(option, option.replace("option", "option "))


def method_blocks(method: OptionStudy, beside: Campaign | None) -> Iterator[Block]:
    """Parameters, errors over all poses, errors over the rest; with a campaign of the thesis beside them."""
    chosen, total = len(method.identified[0].rows), len(method.data)
    yield _parameters(method, beside)
    nominal = error_stats(method.nominal)
    on_all = [(one, one.on_all, nominal) for one in method.identified]
    on_rest = [(one, one.on_rest, error_stats(method.nominal[one.rest])) for one in method.identified]
    printed = (beside.on_all, beside.on_rest) if beside else (None, None)
    yield _errors(nominal, on_all, printed[0], f"All {total} poses (thesis Tables 6.4, 6.6)")
    title = f"The {total - chosen} poses not among the {chosen} chosen ones (thesis Tables 6.5, 6.7)"
    yield _errors(nominal, on_rest, printed[1], title)
    yield _shapes(method)


def options_document(methods: Sequence[OptionStudy], crossed: CrossLoadResult | None, with_thesis: bool) -> Document:
    """Result of `options`, schema `lrm/options/1`: Table 6.8 if there are two data sets."""
    values: dict[str, object] = {"data_sets": [_method(method) for method in methods]}
    if crossed is None:
        return Document([], "lrm/options/1", values, _error_rows(methods[0]))
    names = [method.data.source.path.stem for method in methods]
    values["cross_load"] = [
        {
            "option": crossed.option.name,
            "identified_on": names[i],
            "measured_on": names[j],
            "error": crossed.error(i, j),
        }
        for i in range(2)
        for j in range(2)
    ]
    return Document([_crossed(crossed, names, with_thesis)], "lrm/options/1", values, _error_rows(methods[0]))


def shapes_of(method: OptionStudy) -> Iterator[tuple[str, ErrorDistribution]]:
    """The nominal arm's errors over all poses, each option's over the rest."""
    yield NOMINAL, error_distribution(method.nominal)
    for one in method.identified:
        yield one.option.name, error_distribution(one.residual[one.rest])


def crossed_rows(crossed: CrossLoadResult, names: Sequence[str]) -> ResultTable:
    """The numbers behind the cross-load figure: a row per pose and data set, a column per parameter set (mm)."""
    rows: list[tuple[object, ...]] = []
    for j, name in enumerate(names):
        chosen = (~crossed.both[j].rest).astype(int)
        own, other = (norms_mm(crossed.residual[i][j]) for i in range(2))
        rows += [(name, *row) for row in zip(range(len(own)), chosen, own, other, strict=True)]
    return ResultTable(("measured_on", "row", "chosen_there", *(f"{name}_mm|.4f" for name in names)), rows)


def _error_rows(method: OptionStudy) -> ResultTable:
    """The numbers behind the figure of one data set: a row per pose, a column per option (mm)."""
    names = [one.option.name for one in method.identified]
    errors: list[Array] = [norms_mm(method.nominal), *(norms_mm(one.residual) for one in method.identified)]
    chosen = [(~one.rest).astype(int) for one in method.identified]
    columns = ("pose", *(f"{name}_mm|.4f" for name in (NOMINAL, *names)), *(f"{name}_chosen" for name in names))
    return ResultTable(columns, list(zip(method.data.pose, *errors, *chosen, strict=True)))


def _parameters(method: OptionStudy, beside: Campaign | None) -> ResultTable:
    names, fits = [one.option.name for one in method.identified], [one.fit.model for one in method.identified]
    rows: list[tuple[object, ...]] = []
    for key in (key for pattern in SHOWN for key in fits[0].keys if fnmatchcase(key, pattern)):
        name, scale, unit = screen_unit(fits[0], key)
        values = (fitted.value(key) * scale if key in fitted.free else None for fitted in fits)
        rows.append((name.partition(".")[2], *values, unit))
        if beside:
            rows.append(("  thesis", *(beside.parameters.get(name, {}).get(key) for name in names), ""))
    columns = ("", *(f"{label(name)}|.3g" for name in names), "unit")
    return ResultTable(columns, rows, "Identified parameters (thesis Tables 6.1 to 6.3; more with --json)")


def _errors(
    nominal: ErrorStats,
    options: Sequence[tuple[OptionResult, ErrorStats, ErrorStats]],
    thesis: Mapping[str, PublishedError] | None,
    title: str,
) -> ResultTable:
    """Errors of each option beside the nominal arm's on the same poses; `thesis`: the figures that it prints."""

    def published(name: str) -> tuple[float | None, ...]:
        """Mean, maximum and SD (mm) that the thesis prints for an option; empty without its figures."""
        if thesis is None:
            return ()
        printed = thesis.get(name)
        return (None, None, None) if printed is None else (printed.mean_mm, printed.max_mm, printed.sd_mm)

    rows: list[tuple[object, ...]] = [("nominal (all)", 0, *_three(nominal), None, *published(NOMINAL))]
    for one, error, base in options:
        reduced = f"{100 * (1 - error.mean / base.mean):.1f} %"
        name = one.option.name
        rows.append((label(name), len(one.fit.model.free), *_three(error), reduced, *published(name)))
    columns = ["", "parameters|", "mean mm|.2f", "max mm|.2f", "SD mm|.2f", "mean reduced by|"]
    return ResultTable([*columns, *(("thesis mean|.2f", "max|.1f", "SD|.2f") if thesis else ())], rows, title)


def _shapes(method: OptionStudy) -> ResultTable:
    columns = ("", "median mm|.2f", "90 % below|.2f", "Gaussian says|.2f", "skewness|+.2f", "A*|.1f", "Gaussian?")
    rows: list[tuple[object, ...]] = []
    for name, shape in shapes_of(method):
        lengths = (shape.quantile(0.5), shape.quantile(0.9), shape.mean + GAUSSIAN_90 * shape.sd)
        verdict = "cannot be refused" if shape.is_gaussian else "no"
        rows.append((label(name), *(1e3 * length for length in lengths), shape.skewness, shape.misfit, verdict))
    title = "How the errors are distributed (rest), beside a Gaussian of the same mean and SD"
    return ResultTable(columns, rows, title)


def _crossed(crossed: CrossLoadResult, names: Sequence[str], with_thesis: bool) -> ResultTable:
    """Table 6.8: each data set's parameters on both data sets, over the poses not chosen there."""
    columns = ["identified on", "poses|", *(f"{what} on {name}|.2f" for name in names for what in ("mean", "max"))]
    rows: list[tuple[object, ...]] = []
    for i, name in enumerate(names):
        errors = [1e3 * value for j in range(2) for value in (crossed.error(i, j).mean, crossed.error(i, j).max)]
        printed = [value for load in LOADS for value in TABLE_6_8[LOADS[i], load]] if with_thesis else []
        rows.append((name, len(crossed.both[i].rows), *errors, *printed))
    columns += ["thesis mean|.2f", "thesis max|.2f"] * 2 if with_thesis else []
    return ResultTable(columns, rows, f"Cross-load, {label(crossed.option.name)} (thesis Table 6.8), mm")


def _method(method: OptionStudy) -> dict[str, object]:
    options = [_identified(method, one) for one in method.identified]
    return {
        "data": method.data.source.path.name,
        "poses": len(method.data),
        "nominal": error_stats(method.nominal),
        "options": options,
    }


def _identified(method: OptionStudy, one: OptionResult) -> dict[str, object]:
    shape = error_distribution(one.residual[one.rest])
    return {
        "option": one.option.name,
        "bounded": one.option.physical,
        "chosen_poses": method.data.pose[one.rows],
        "error": {"chosen": one.on_chosen, "all": one.on_all, "rest": one.on_rest},
        "estimates": estimates(one.fit, se_at_bound=0.0),
        "distribution": {
            "skewness": shape.skewness,
            "anderson_darling": shape.misfit,
            "gaussian": shape.is_gaussian,
            "gaussian_below_zero": shape.below_zero,
        },
    }


def _three(error: ErrorStats) -> tuple[float, float, float]:
    return error.mean * 1e3, error.max * 1e3, error.sd * 1e3
