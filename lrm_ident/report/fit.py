"""Reports of `fit` and `compare`: estimates, parameters that cannot be identified, errors, and what they depend on."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data import wording
from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import change_words, decimals, in_mm, in_percent, poses_count
from lrm_ident.fitting.identifiability import FEW_OUTLIERS
from lrm_ident.fitting.levenberg_marquardt import Fit, implausible_of
from lrm_ident.fitting.prior_conflict import unusual_dimensions
from lrm_ident.report.document import Block, CommandLine, Document, ResultTable, heading, section
from lrm_ident.report.effects import field_blocks, field_values
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.text.notices import fit_words
from lrm_ident.report.text.poses import influential_poses_sentence
from lrm_ident.report.text.residuals import predictable_sentence, why_not_held_out
from lrm_ident.report.text.variables import variable_name
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.error_breakdown import Factor, HeldOutResidual, ModelComparison, PoseGroup
from lrm_ident.residual.gravity_loads import usual_turns
from lrm_ident.residual.influential_poses import influential_poses
from lrm_ident.residual.noise_floor import NoiseFloor, noise_floor
from lrm_ident.study.model_on_data import ErrorSummary
from lrm_ident.study.parameter_estimates import parameter_estimates
from lrm_math.arrays import Array
from lrm_math.model.deployed_model import field_of, named_part
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

FACTORS_SHOWN, STRONG, LITTLE = 3, 0.95, 0.02
FROM_DATA = (
    "from data: share of a parameter's prior variance that the poses removed. At 0 % the estimate is only its typical "
    "size: these poses cannot distinguish it from others, or do not show it."
)
USUAL = "usual load|"
USUAL_LOAD = "usual load: how far the compliance turns under gravity, RMS over the poses."
IMPLAUSIBLE = "Implausible: something is missing in the model, or wrong in the data or in the arm file"
DIAGNOSE_WILL = "Names the effect that the model lacks, if these poses show it."
MOSTLY_TOLD, OUTLIERS_SHOWN, MUCH = 0.5, 4, 1.5
MOST_OF_OUTLIERS = (
    0.99  # of the squared error of outliers, that of those to leave out: an error makes outliers of others
)


def error_blocks(errors: ErrorSummary, title: str) -> list[Block]:
    """A table of a model's errors, or the reason why there is no held-out error."""
    held_out = errors.held_out.error
    stats = [("nominal arm, before any fit", errors.nominal), ("model, at the poses of its fit", errors.fitted)]
    if held_out is not None:
        stats.append(("model, held out (not in its fit)", held_out))
    stats += deployed_rows(errors.held_out.deployed, held_out)
    if errors.nameless is not None:
        stats.append(("black-box model (pattern, no cause)", errors.nameless.error))
    spec = f".{decimals(*(error.rms * 1e3 for _, error in stats))}f"
    columns = ["error of the tip, mm", *(f"{name}|{spec}" for name in ("mean", "RMS", "max"))]
    turns = [None if error.turn_rms is None else float(np.degrees(error.turn_rms)) for _, error in stats]
    turns_measured = [turn for turn in turns if turn is not None]
    rows: list[tuple[object, ...]] = [(name, *stats_in_mm(error)[:3]) for name, error in stats]
    if turns_measured:
        columns.append(f"orientation RMS, deg|.{decimals(*turns_measured)}f")
        rows = [(*row, turn) for row, turn in zip(rows, turns, strict=True)]
    table = ResultTable(columns, rows, title)
    deployed = errors.held_out.deployed
    state = [] if deployed is None or deployed.state is None else [deployed.state.sentence_with(plain_name)]
    none = [] if errors.held_out.error else [f"held out: none, because {why_not_held_out(errors.held_out)}"]
    return [table, *none, *(words for words in state if words)]


def error_values(errors: ErrorSummary) -> dict[str, object]:
    """The table `error`."""
    reason = {} if errors.held_out.error else {"held_out_reason": why_not_held_out(errors.held_out)}
    nameless = {} if errors.nameless is None else {"nameless": errors.nameless}
    values = {"nominal": errors.nominal, "fit": errors.fitted, "held_out": errors.held_out.error}
    return {**values, "as_deployed": errors.held_out.deployed, **reason, **nameless}


def differ(first: ErrorStats, other: ErrorStats) -> bool:
    """Whether two errors differ as they are printed."""
    return any(in_mm(a * 1e-3) != in_mm(b * 1e-3) for a, b in zip(stats_in_mm(first), stats_in_mm(other), strict=True))


def deployed_rows(deployed: DeployedError | None, held_out: ErrorStats | None) -> list[tuple[str, ErrorStats]]:
    """Rows of a table of errors for a model as it is deployed, where they differ from the error in its session.

    The first is the error that the daemon realises, from its own record of time and moves. Others stand below it only.
    """
    if deployed is None:
        return []
    remembers = deployed.state is not None and deployed.state.memory
    rows = {
        f"held out, as deployed on the arm{'' if deployed.among_measured is None else ', later'}": deployed.now,
        "as deployed, among the measured poses": deployed.among_measured,
        "as deployed, at earlier poses": deployed.otherwise,
        f"as deployed, {'no record of its moves' if remembers else 'power-on time unknown'}": deployed.time_unknown,
    }
    lead, *others = ((name, error) for name, error in rows.items() if error is not None)
    below = [row for row in others if held_out is None or differ(row[1], held_out)]
    return [lead, *below] if below or held_out is None or differ(lead[1], held_out) else []


def fit_document(fit: Fit, errors: ErrorSummary, data: Measurements) -> Document:
    """Result of `lrm-ident fit`, schema `lrm/fit/1`."""
    model = fit.model
    fitted, before, held_out = errors.fitted.rms, errors.nominal.rms, errors.held_out.error
    outliers = [(data.pose[row], float(np.linalg.norm(fit.residual[row]) * 1e3)) for row in fit.outliers]
    how = fit_words(fit.loss.name, data.source.left_out)
    unseen = "" if held_out is None else f"; {wording.UNSEEN} it is {in_mm(held_out.rms)} mm"
    blocks = [
        heading(f"The RMS error {change_words(before, fitted)}{unseen}."),
        *_beside_noise(noise_floor(data, fit.equilibrium), errors.held_out, fit.residual, data.pose),
        *error_blocks(errors, f"{poses_count(len(data))}, {len(model.free)} parameters{how and '; ' + how}"),
        *section(IMPLAUSIBLE, (estimate.sentence for estimate in implausible_of(fit))),
        *_unlike_the_drawing(fit),
        *_outlier_words(outliers),
        *_without_outliers(fit, data),
    ]
    if fit.stated is not None:  # a prior holds the parameters that the poses do not determine
        few, count = int((fit.told < MOSTLY_TOLD).sum()), len(fit.told)
        blocks.append(f"The poses determine {count - few} of {count} parameters; {few} stay near their typical sizes.")
    table = parameter_table(fit)
    details: list[Block] = [
        table,
        *([] if fit.stated is None else [FROM_DATA]),
        *([USUAL_LOAD] if USUAL in table.columns else []),
        *section(f"Correlated above {STRONG}:", _correlated(fit)),
        *section("Outliers:", (f"pose {pose}: {in_mm(error * 1e-3)} mm" for pose, error in outliers)),
    ]
    values = {
        "poses": len(data),
        "parameters": len(model.free),
        "loss": fit.loss.name,
        "left_out": data.source.left_out,
        "prior": None if fit.stated is None else fit.stated.name,
        "error": error_values(errors),
        "residual_sd_per_axis_mm": fit.sigma * 1e3,
        "steps": fit.steps,
        "estimates": estimates(fit, se_at_bound=None),
        "correlation": {"keys": model.free, "matrix": np.round(fit.correlation, 6)},
        "implausible": [
            {"parameter": estimate.key, "value": estimate.value, "unit": estimate.unit}
            for estimate in implausible_of(fit)
        ],
        "far_from_arm_file": unusual_dimensions(fit),
        "outliers": [{"pose": pose, "error_mm": error} for pose, error in outliers],
    }
    return Document(blocks, "lrm/fit/1", values, details=details, about="every parameter with its standard error")


def _unlike_the_drawing(fit: Fit) -> Iterator[str]:
    """The dimensions that the poses determine far from those of the arm file, in one line."""
    sizes = []
    for key in unusual_dimensions(fit):
        name, factor, unit = screen_unit(fit.model, key)
        sizes.append(f"{name} by {fit.model.value(key) * factor:+.1f} {unit}")
    if sizes:
        shown = wording.enumerate_words(sizes, OUTLIERS_SHOWN)
        yield f"Far from the arm file: {shown}. Is it right there, or does the model lack an effect?"


def _outlier_words(outliers: Sequence[tuple[int, float]]) -> Iterator[str]:
    """The outliers in one line."""
    if outliers:
        far = sorted(outliers, key=lambda outlier: -outlier[1])
        shown = wording.enumerate_words([f"{pose} ({in_mm(error * 1e-3)} mm)" for pose, error in far], OUTLIERS_SHOWN)
        yield (
            f"Outliers: {poses_count(len(far))}, numbers {shown}. Measured wrongly, or the effect that the model lacks "
            "shows there."
        )


def _beside_noise(
    floor: NoiseFloor, held_out: HeldOutResidual, residual: Array, numbers: NDArray[np.int64]
) -> Iterator[str]:
    """How the held-out error compares with the noise of the measurement, where both are known.

    By repeated poses the noise is at most so large: what the model lacks can make repeats differ, too.
    `residual`: (N, 3), m, of the fit. `numbers`: (N,), of the poses.
    """
    if (noise := floor.rms) is None or held_out.residual is None or held_out.error is None:
        return
    times = held_out.error.rms / noise
    influential = influential_poses(residual, held_out.residual)
    if influential and times >= MUCH:
        yield influential_poses_sentence(influential, numbers)
        return
    what = "noise of repeated poses" if floor.source == "replicates" else "stated noise"
    lacks = "no effect is known to be missing" if times < MUCH else "the model lacks some effect"
    yield f"{in_mm(held_out.error.rms)} mm is {times:.1f} times the {what} ({in_mm(noise)} mm): {lacks}."


def _without_outliers(fit: Fit, data: Measurements) -> list[Block]:
    """Options that fit without the outliers, where these are few and more than half of the squared error is theirs.

    Others may be the poses at which a missing effect shows most, and are better kept.
    """
    squares = (fit.residual**2).sum(axis=1)
    if not len(fit.outliers) < FEW_OUTLIERS * len(data) or squares[[*fit.outliers]].sum() <= 0.5 * squares.sum():
        return []
    far = sorted(fit.outliers, key=lambda row: -squares[row])
    most = int(np.searchsorted(np.cumsum(squares[far]), MOST_OF_OUTLIERS * squares[far].sum())) + 1
    numbers = ",".join(str(data.pose[row]) for row in sorted(far[:most]))
    return [f"If they are wrong, fit again without them: add --leave-out {numbers}. To weigh them less: --loss huber"]


def comparison_document(comparison: ModelComparison, files: Sequence[str] = ()) -> Document:
    """Result of `lrm-ident compare`, schema `lrm/comparison/1`. `files`: model and data, for the next command."""
    data = comparison.data
    free = len(comparison.equilibrium.model.free)
    errors = ErrorSummary(comparison.nominal, comparison.error, comparison.held_out, comparison.predictable)
    field = field_of(comparison.equilibrium.model)
    box = comparison.predictable
    said = "" if box is None else predictable_sentence(box)
    black_box = [f"{said[0].upper()}{said[1:]}"] if said else []
    held_out = None if comparison.held_out.error is None else comparison.held_out.error.rms
    unseen = "" if held_out is None else f", {in_mm(held_out)} mm {wording.UNSEEN}"
    title = f"{poses_count(len(data))}, {free} parameters"
    blocks = [
        heading(f"{title}: RMS error {in_mm(comparison.error.rms)} mm{unseen}."),
        *_beside_noise(noise_floor(data, comparison.equilibrium), comparison.held_out, comparison.residual, data.pose),
        *_depends_on(comparison.factors),
        *error_blocks(errors, ""),
        *(() if field is None else field_blocks(comparison, field)),
        *([said] if (said := _outside(comparison)) else []),
        _factor_table(comparison.factors[:FACTORS_SHOWN]),
        *diagnose_next(files),
    ]
    details: list[Block] = [
        *black_box,
        *(_group_table(factor) for factor in comparison.factors[:2]),
        _factor_table(comparison.factors),
        _worst_table(comparison),
    ]
    values = {
        "poses": len(data),
        "parameters": free,
        "outside_range": [data.pose[row] for row in _rows_outside(comparison)],
        "error": error_values(errors),
        **({} if field is None else {"field": field_values(comparison, field)}),
        "factors": [
            {
                "kind": f.variable.kind,
                "name": variable_name(f.variable),
                "share": f.share,
                "groups": list(map(_group, f.groups)),
            }
            for f in comparison.factors
        ],
        "worst_poses": [
            {
                "pose": data.pose[row],
                "q_deg": np.round(np.degrees(data.poses.q[row]), 6),
                "payload_g": data.poses.payload[row] * 1e3,
                "error_mm": np.linalg.norm(comparison.residual[row]) * 1e3,
                "residual_mm": comparison.residual[row] * 1e3,
            }
            for row in comparison.worst
        ],
    }
    about = "groups of poses, all factors, the worst poses"
    return Document(blocks, "lrm/comparison/1", values, details=details, about=about)


def diagnose_next(files: Sequence[str]) -> list[Block]:
    """The command that names what is missing, where the files are known."""
    if not files:
        return []
    return ["", CommandLine(f"Next: lrm-ident diagnose {shlex.join(files)}"), f"      {DIAGNOSE_WILL}"]


def _depends_on(factors: Sequence[Factor]) -> Iterator[str]:
    """What the error depends on most, if on anything."""
    if factors and factors[0].share >= LITTLE:
        share = in_percent(factors[0].share)
        yield f"The error depends most on the {variable_name(factors[0].variable)} ({share} % of the squared error)."


def _rows_outside(comparison: ModelComparison) -> list[int]:
    """Rows of poses outside the range that the model was fitted on."""
    within = comparison.equilibrium.model.within
    return [] if within is None else np.flatnonzero(within.outside(comparison.data.poses.q).any(axis=1)).tolist()


def _outside(comparison: ModelComparison) -> str:
    """Number of poses outside that range, and the error there and within; empty if none does."""
    within, rows = comparison.equilibrium.model.within, _rows_outside(comparison)
    if within is None or not rows:
        return ""
    there, rest = error_stats(comparison.residual[rows]), np.delete(comparison.residual, rows, axis=0)
    inside = f", {in_mm(error_stats(rest).rms)} mm within" if len(rest) else ""
    error = f"Error of the model as it is: RMS {in_mm(there.rms)} mm there{inside}"
    return f"{within.sentence(comparison.data.poses.q)}. {error}"


def _worst_table(comparison: ModelComparison) -> ResultTable:
    data, residual, places = comparison.data, comparison.residual * 1e3, decimals(comparison.error.rms * 1e3)
    q, load = np.degrees(data.poses.q), data.poses.payload * 1e3
    angles = " ".join(f"{'q' + str(i + 1):>4s}" for i in range(q.shape[1]))
    rows = []
    for i in comparison.worst:
        turned = " ".join(f"{angle:4.0f}" for angle in q[i])
        rows.append((data.pose[i], turned, load[i], np.linalg.norm(residual[i]), _vector(residual[i], places)))
    columns = ("pose|", angles + "|", "load g|.1f", f"error mm|.{places}f", "residual mm|")
    return ResultTable(columns, rows, "The worst poses (angles in deg)")


def parameter_table(fit: Fit) -> ResultTable:
    """Estimates with standard errors, and how much of them the data told; angles in degrees."""
    by_key = parameter_estimates(fit)
    told = {key: estimate.from_data for key, estimate in by_key.items() if estimate.from_data is not None}
    return estimate_table(
        fit.model, {key: estimate.standard_error for key, estimate in by_key.items()}, told, fit.equilibrium
    )


def estimate_table(
    model: Model,
    errors: Mapping[str, float | None],
    told: Mapping[str, float] | None = None,
    rest: Equilibrium | None = None,
) -> ResultTable:
    """The free parameters of a model with their standard errors, those without one being at a bound; angles in degrees.

    `errors`: in the units of the keys. `told`: the part (0 to 1) of what was unknown of them that the data removed, the
    rest being their typical size. Coefficients of a residual field, of which none means anything, are counted only.
    `rest`: where it is known, how far each compliance turns under the usual load is told.
    """
    rows, named = [], named_part(model).free
    turns = {} if rest is None else _turned(model, rest)
    for key in named:
        name, scale, unit = screen_unit(model, key)
        error, si = errors.get(key), model.parameter(key).si
        value, sd = wording.with_error(model.value(key) * scale, (error or 0.0) * si * scale)
        share = [f"{in_percent(told[key])} %" if key in told else ""] if told else []
        turn = [turns.get(key)] if turns else []
        rows.append((name, value, "at its bound" if error is None else f"± {sd}", unit, *share, *turn))
    more = (*(["from data|"] if told else []), *([USUAL] if turns else []))
    columns = ("parameter", "value|", "± standard error|", "unit", *more)
    field = len(model.free) - len(named)
    beside = f", and {field} numbers of a residual field, which are not causes" if field else ""
    return ResultTable(columns, rows, f"{len(named)} parameters{beside}{wording.named_joints(model.arm)}")


def _turned(model: Model, rest: Equilibrium) -> dict[str, str]:
    """Turn of every free compliance under the usual load, by its key."""
    turned = {}
    for effect in model.effects:
        turns = usual_turns(effect, rest)
        for key, parameter in zip(effect.keys, effect.parameters, strict=True):
            if parameter.name in turns and key in model.free:
                turned[key] = f"{np.degrees(turns[parameter.name] * model.value(key)):.2g}°"
    return turned


def estimates(fit: Fit, se_at_bound: float | None) -> dict[str, dict[str, object]]:
    """Value and standard error of each free parameter for JSON, in the units of the keys."""
    return {
        key: {
            "value": estimate.value,
            "se": se_at_bound if estimate.standard_error is None else estimate.standard_error,
            "at_bound": estimate.standard_error is None,
            "told_by_data": estimate.from_data,
        }
        for key, estimate in parameter_estimates(fit).items()
    }


def screen_unit(model: Model, key: str) -> tuple[str, float, str]:
    """A key without its unit, what to multiply an SI value by for the terminal, and the unit to print."""
    parameter = model.parameter(key)
    name = key.removesuffix("_" + parameter.unit)
    if parameter.unit == "rad":
        return name, float(np.degrees(1.0)), "deg"
    return name, 1.0 / parameter.si, parameter.unit.replace("_per_", "/")


def stats_in_mm(error: ErrorStats) -> tuple[float, float, float, float]:
    """Mean, RMS, maximum and SD (mm)."""
    return error.mean * 1e3, error.rms * 1e3, error.max * 1e3, error.sd * 1e3


def _correlated(fit: Fit) -> Iterator[str]:
    """Pairs of parameters whose estimates depend on each other."""
    for i, row in enumerate(fit.correlation):
        for j in range(i):
            if abs(row[j]) > STRONG:
                yield f"{fit.model.free[j]} and {fit.model.free[i]}: {row[j]:+.3f}"


def _factor_table(factors: Sequence[Factor]) -> ResultTable:
    spec = f".{decimals(*(factor.worst.error.rms * 1e3 for factor in factors))}f"
    columns = ("grouped by", "explains|", "worst group", f"RMS mm|{spec}", "poses|")
    rows = []
    for factor in factors:
        explains = "< 1 %" if 0 < factor.share < 0.01 else f"{in_percent(factor.share)} %"
        worst = factor.worst
        rows.append((variable_name(factor.variable), explains, worst.label, worst.error.rms * 1e3, worst.count))
    return ResultTable(columns, rows, "Where the model fails: share of the squared error that each explains, alone")


def _group_table(factor: Factor) -> ResultTable:
    places = decimals(*(group.error.rms * 1e3 for group in factor.groups))
    columns = ["group", "poses|", f"mean|.{places}f", f"RMS mm|.{places}f", "residual x y z mm|"]
    rows: list[tuple[object, ...]] = []
    for group in factor.groups:
        turn = () if group.equivalent_rotation is None else (np.degrees(group.equivalent_rotation),)
        bias = _vector(1e3 * np.array(group.bias), places)
        rows.append((group.label, group.count, *stats_in_mm(group.error)[:2], bias, *turn))
    if factor.groups[0].equivalent_rotation is not None:
        columns.append(f"turn of joint {(factor.variable.joint or 0) + 1} deg|+.2f")
    return ResultTable(columns, rows, f"By {variable_name(factor.variable)}")


def _vector(mm: Array, places: int) -> str:
    return " ".join(f"{component:+{places + 4}.{places}f}" for component in mm)


def _group(group: PoseGroup) -> dict[str, object]:
    turn = {} if group.equivalent_rotation is None else {"acts_like_deg": np.degrees(group.equivalent_rotation)}
    bias = 1e3 * np.array(group.bias)
    return {"label": group.label, "poses": group.count, **group.error.as_json(), "bias_mm": bias, **turn}
