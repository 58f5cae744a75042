"""Reports of `choose-poses`, `design` and `identify-parameters`: what poses tell of parameters and of rival effects."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lrm_ident.data.measurement_file.known_columns import quantities_of_joints
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.wording import in_percent
from lrm_ident.design.discrimination import TARGET_POWER, TEST_LEVEL
from lrm_ident.design.expected_lead import NEEDED, TRIALS, CausePair
from lrm_ident.design.observability import INDICES, UNITS, Observability, Units
from lrm_ident.design.parameter_elimination import ParameterElimination
from lrm_ident.design.pose_design import CandidateSet, ClearAngles, DesignProblem, ExpectedAccuracy, PoseDesign
from lrm_ident.design.pose_selection import PoseSelection
from lrm_ident.fitting.dependence import UnidentifiableParameter
from lrm_ident.fitting.parameter_sets import TABLE_4_5
from lrm_ident.report.document import Block, Document, ResultTable, heading, section, stated
from lrm_ident.report.fit import screen_unit, stats_in_mm
from lrm_ident.report.plain_names import plain_name, symbol
from lrm_ident.report.text.advice import candidates_words, provided_words
from lrm_ident.report.text.claims import with_unit
from lrm_ident.report.text.poses import limitation_sentence
from lrm_ident.residual.data_audit import Limitation, audit
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

WORST_SHOWN = 8
TOO_FEW = (
    "{} poses are too few for a fit by themselves: it takes as many distinct ones as it keeps parameters, here {}."
)
ALIKE, PARTS_SHOWN, PER_LINE = 0.2, 3, 9
UNIT_WORDS = {"thesis": "mm per rad, mm or rad/Nmm", "scaled": "mm per typical size"}


def choice_document(model: Model, selection: PoseSelection, data: Measurements) -> Document:
    """Result of `lrm-ident choose-poses`, schema `lrm/choice/1`; its figure shows every pose and where its TCP is."""
    n, best, o1 = len(selection.rows), selection.o1_upper_bound, selection.observability.O1
    title = f"{n} of {len(data)} poses, {len(model.free)} parameters"
    fits = []
    for fit in selection.fits:
        rest = "–" if fit.error_rest is None else fit.error_rest.mean * 1e3
        broken = ", ".join(f"{symbol(key)} = {fit.fit.model.value(key):.3g}" for key in fit.violated_bounds)
        fits.append((fit.name, *stats_in_mm(fit.error_all)[:2], rest, broken or "nothing"))
    columns = ("fit", "mean mm, all|.2f", "RMS mm, all|.2f", "mean mm, others|.2f", "against physics")
    blocks: list[Block] = [
        _index_table(title, selection.observability, selection.random_baseline),
        f"O1 reaches {100 * o1 / best:.1f} % of {best:.4g}, which no {n} of these poses can exceed.",
        ResultTable(columns, fits, "Identified on them"),
        f"Poses: {' '.join(map(str, data.pose[selection.rows]))}",
    ]
    values = {
        "poses": data.pose[selection.rows],
        "observability": selection.observability,
        "drawn_blindly": selection.random_baseline,
        "o1_no_choice_exceeds": best,
        "identified": [
            {
                "how": fit.name,
                "error_all": fit.error_all,
                "error_rest": fit.error_rest,
                "against_physics": fit.violated_bounds,
                "at_bound": fit.fit.at_bound,
            }
            for fit in selection.fits
        ],
    }
    chosen = np.isin(np.arange(len(data)), selection.rows).astype(int)
    poses = zip(data.pose, chosen, *(data.tcp.T * 1e3), strict=True)
    behind = ResultTable(("pose|d", "chosen|d", "x_mm|.4f", "y_mm|.4f", "z_mm|.4f"), list(poses))
    return Document(blocks, "lrm/choice/1", values, behind)


def design_document(task: DesignProblem, offer: CandidateSet, chosen: PoseDesign) -> Document:
    """Result of `lrm-ident design`, schema `lrm/design/2`; its figure shows expected errors and detectable sizes."""
    repeats, gains = len(chosen.poses) - len(chosen.rows), list(_gains(task, chosen))
    leads = [*_leads(chosen), *_holds(chosen)]
    described = candidates_words(offer.origin) if isinstance(offer.origin, ClearAngles) else offer.origin
    limitations: tuple[Limitation, ...] = ()  # poses that add to measured ones are audited with these
    if task.measured is None and task.prior is None:
        torque = solve_equilibrium(task.model, chosen.poses).joint_torque
        limitations = audit(chosen.poses, torque)
    together = len(chosen.rows) + (0 if task.measured is None else len(task.measured))
    title = f"{len(chosen.rows)} poses, {len(chosen.keys)} parameters"
    blocks: list[Block] = [
        heading(f"{title}, the arm known beforehand" if task.prior is not None else title),
        gains[0],
        *leads,
        *_distinguished(task, chosen),
        f"To measure: {len(chosen.poses)} poses, {repeats} of them again (repeat_of), in random order. Approach "
        "each joint from the side in the columns approach1, approach2 …: +1 from smaller angles, -1 from larger ones.",
        *([TOO_FEW.format(together, len(chosen.keys))] if together < len(chosen.keys) and task.prior is None else []),
        *section("\nWhat these poses lack", map(limitation_sentence, limitations)),
    ]
    details: list[Block] = [
        *gains[1:],
        f"Candidates: {described}.",
        *(f"  refused: {count} with {rule}" for rule, count in offer.rejected.items() if count),
        *([] if task.prior is not None else [_index_table(title, chosen.observability, chosen.random_baseline)]),
        _error_table(chosen),
    ]
    values = {
        "candidates": len(offer.poses),
        "candidates_in_words": described,
        "refused": offer.rejected,
        "poses": len(chosen.rows),
        "repeats": repeats,
        "hold_s": chosen.dwell,
        "distinguished_in_trials": [
            {"there": there, "instead": instead, "of": TRIALS, "told": count}
            for (there, instead), count in chosen.trials.items()
        ],
        "noise_mm": task.noise * 1e3,
        "parameters": chosen.keys,
        "observability": chosen.observability,
        "drawn_blindly": chosen.random_baseline,
        "now": None if chosen.before is None else _knowledge(chosen, chosen.before),
        "with_these": _knowledge(chosen, chosen.after),
        "with_blind_ones": _knowledge(chosen, chosen.random_after),
        "in_words": [*gains, *leads],
        "limitations": stated(limitations, limitation_sentence),
    }
    about = "candidates, observability indices, the least known parameters"
    return Document(blocks, "lrm/design/2", values, _knowledge_table(chosen), details, about)


def pose_table(chosen: PoseDesign) -> ResultTable:
    """The pose file, in the order to measure."""
    poses, q = chosen.poses, np.degrees(chosen.poses.q)
    sides = np.zeros_like(q) if poses.direction is None else poses.direction
    angles, _, approaches = (quantity.columns for quantity in quantities_of_joints(q.shape[1]))
    columns = ["pose|d", *(f"{name}|.6f" for name in angles), "payload_g|.3f"]
    columns += [*(f"{name}|.0f" for name in approaches), "repeat_of|d"]
    parts = [chosen.number, *q.T, poses.payload * 1e3, *sides.T, chosen.repeat_of]
    if chosen.dwell:
        columns.append("hold_s|.0f")
        parts.append(chosen.hold)
    return ResultTable(columns, list(zip(*parts, strict=True)))


def _index_table(title: str, chosen: Observability, random: Observability) -> ResultTable:
    columns = ("columns: mm per typical size", *(f"{name}|.4g" for name in INDICES))
    named = (("chosen", chosen), ("random (median)", random))
    return ResultTable(columns, [(name, *vars(indices).values()) for name, indices in named], title)


def known_sets(chosen: PoseDesign) -> dict[str, ExpectedAccuracy]:
    """Accuracy expected of each set of poses that there is."""
    sets = {"now": chosen.before, "with these": chosen.after, "with random poses": chosen.random_after}
    return {name: knowledge for name, knowledge in sets.items() if knowledge is not None}


def _error_table(chosen: PoseDesign) -> ResultTable:
    """The parameters that stay least known, as motion of the TCP."""
    accuracies = known_sets(chosen)
    columns = ("parameter (mm of TCP motion)", *(f"{name}|.3f" for name in accuracies))
    worst = np.argsort(-chosen.after.standard_errors)[:WORST_SHOWN]
    rows = [(chosen.keys[j], *(knowledge.standard_errors[j] for knowledge in accuracies.values())) for j in worst]
    return ResultTable(columns, rows, "Least known: expected standard errors")


def _knowledge_table(chosen: PoseDesign) -> ResultTable:
    """Expected standard errors as motion of the TCP (mm), and least detectable sizes of rivals (typical sizes).

    A cell is empty where a rival is never detectable.
    """
    accuracies = known_sets(chosen)
    errors = zip(*(knowledge.standard_errors for knowledge in accuracies.values()), strict=True)
    rows: list[tuple[object, ...]] = [(key, "mm", *row) for key, row in zip(chosen.keys, errors, strict=True)]
    for rivals in zip(*(knowledge.rivals for knowledge in accuracies.values() if knowledge.rivals), strict=True):
        rows.append((rivals[0].name, "typical sizes", *(rival.detectable_size for rival in rivals)))
    return ResultTable(("what", "unit", *(f"{name.replace(' ', '_')}|.6g" for name in accuracies)), rows)


def _gains(task: DesignProblem, chosen: PoseDesign) -> Iterator[str]:
    """Expectation of what the poses identify and separate, one sentence each."""
    current = "" if chosen.before is None else f"{chosen.before.tcp:.3g} mm now, "
    yield (
        f"Expected error of the tip from the parameters alone: {chosen.after.tcp:.3g} mm RMS over the candidates "
        f"({current}{chosen.random_after.tcp:.3g} mm with random poses; noise {task.noise * 1e3:g} mm per axis)."
    )
    was = None if chosen.before is None else chosen.before.discrimination
    apart, random = chosen.after.discrimination, chosen.random_after.discrimination
    if apart is None or random is None:
        return
    if len(apart.rivals) > 1:
        earlier = "" if was is None else f"{was.cosine:.2f} now, "
        first, other = (plain_name(rival.name) for rival in apart.rivals[:2])
        yield (
            f"Cosine between the motions of {first} and {other}: {apart.cosine:.2f} "
            f"({earlier}{random.cosine:.2f} with random poses; at 1 they are indistinguishable)."
        )


def _leads(chosen: PoseDesign) -> Iterator[str]:
    """What a diagnosis after these poses is expected to tell of each pair of rivals of typical size."""
    least: dict[frozenset[str], CausePair] = {}
    for pair in chosen.pairs:
        both = frozenset((pair.there, pair.instead))
        least[both] = min(
            least.get(both, pair), pair, key=lambda rivals: (rivals.distinguishable_if_exact, rivals.lead)
        )
    for pair in least.values():
        will, ways = pair.distinguishable_if_exact, ((pair.there, pair.instead), (pair.instead, pair.there))
        tried = ", ".join(f"{there} led in {chosen.trials[there, instead]}" for there, instead in ways)
        yield (
            f"At typical sizes a diagnosis {'will' if will else 'will not'} distinguish {pair.there} from "
            f"{pair.instead}{provided_words([pair])}: it is expected to lead by {pair.lead:.1f} standard errors, "
            f"{NEEDED:.1f} are needed; cosine {pair.cosine:.2f}. Tried on {TRIALS} simulated measurements of each: "
            f"{tried}."
        )


def _holds(chosen: PoseDesign) -> Iterator[str]:
    """How long the arm stands at poses before they are measured."""
    if chosen.dwell:
        waiting = float(chosen.hold.sum()) / 60.0
        yield (
            f"Half of the poses are held for {chosen.dwell:g} s before the reading (hold_s): {waiting:.0f} min of "
            "waiting in all. What yields slowly shows there, and what yields at once shows at the others."
        )


def _distinguished(task: DesignProblem, chosen: PoseDesign) -> Iterator[ResultTable]:
    """The least size at which each rival is distinguished from all else, and its standard error with these poses.

    Both of its first parameter.
    """
    rivals_of = {name: accuracy.rivals for name, accuracy in known_sets(chosen).items() if accuracy.rivals}
    if not rivals_of:
        return
    rows = []
    for k, effect in enumerate(task.rivals):
        parameter = next(p for p in effect.parameters if p.fixed is None)
        sizes = [rivals[k].detectable_size for rivals in rivals_of.values()]
        shown = [
            "never" if size is None else with_unit(size * parameter.typical / parameter.si, None, parameter.unit)
            for size in sizes
        ]
        error = dict(rivals_of["with these"][k].standard_errors).get(parameter.name)
        rows.append((effect.name, *shown, "" if error is None else f"± {with_unit(error, None, parameter.unit)}"))
    power = in_percent(TARGET_POWER)
    columns = ("effect", *(f"{name}|" for name in rivals_of), "standard error|")
    yield ResultTable(columns, rows, f"Smallest size that is distinguished from all else, in {power} % of cases")


def _knowledge(chosen: PoseDesign, accuracy: ExpectedAccuracy) -> dict[str, object]:
    errors = dict(zip(chosen.keys, accuracy.standard_errors, strict=True))
    out = {"tcp_rms_mm": accuracy.tcp, "standard_error_as_tcp_motion_mm": errors}
    if accuracy.discrimination is None:
        return out
    rivals = [
        {
            "effect": rival.name,
            "standard_errors": dict(rival.standard_errors),
            "power_at_typical_size": rival.power,
            "test_level": TEST_LEVEL,
            "found_from_typical_sizes": rival.detectable_size,
        }
        for rival in accuracy.rivals
    ]
    return out | {"cosine": accuracy.discrimination.cosine, "separate": rivals}


def elimination_document(model: Model, elimination: ParameterElimination) -> Document:
    """Result of `lrm-ident identify-parameters`, schema `lrm/identifiability/1`; its figure shows singular values."""
    kept, removed = len(elimination.kept), list(zip(elimination.removals, elimination.held, strict=True))
    sets = {units: {"all": elimination.all_values[units], "kept": elimination.kept_values[units]} for units in UNITS}
    blocks: list[Block] = [
        heading(
            f"{elimination.poses} poses determine {kept} of {len(elimination.keys)} parameters: every singular value "
            f"reaches {elimination.threshold:g} ({UNIT_WORDS[elimination.units]})"
        )
    ]
    details: list[Block] = []
    for units in UNITS:
        details += section(f"\nSingular values, {UNIT_WORDS[units]}:", _singular_values(elimination, units))
    symbols = ("  ".join(map(symbol, elimination.kept[k : k + PER_LINE])) for k in range(0, kept, PER_LINE))
    blocks += section("\nDetermined:", [*symbols, *_against_table_4_5(elimination)])
    why = (f"{removal.key}: {_dependence(model, held)}" for removal, held in removed)
    blocks += section(
        "\nNot determined:", [", ".join(symbol(removal.key) for removal, _ in removed)] if removed else []
    )
    details += section("\nNot determined, in this order, and why:", why)
    values = {
        "poses": elimination.poses,
        "units": elimination.units,
        "threshold_mm": elimination.threshold,
        "kept": elimination.kept,
        "removed": [
            {
                "parameter": removal.key,
                "least_singular_value_before_mm": removal.before,
                "least_singular_value_after_mm": removal.after,
                "survival": held.survival,
                "moves_the_tcp_like": dict(held.combination),
            }
            for removal, held in removed
        ],
        "singular_values_mm": sets,
        "observability": elimination.observability,
    }
    rows = [
        (units, name, number, value)
        for units in UNITS
        for name, singular_values in sets[units].items()
        for number, value in enumerate(singular_values, start=1)
    ]
    behind = ResultTable(("units", "set", "number", "singular_value_mm|.9g"), rows)
    return Document(
        blocks, "lrm/identifiability/1", values, behind, details, "why each is not determined, singular values, indices"
    )


def _singular_values(elimination: ParameterElimination, units: Units) -> Iterator[str]:
    indices = ", ".join(f"{name} {number:.3g}" for name, number in vars(elimination.observability[units]).items())
    yield f"all {len(elimination.keys)}: {_values(elimination.all_values[units])}"
    yield f"the {len(elimination.kept)} kept: {_values(elimination.kept_values[units])}"
    yield f"of those: {indices}"


def _against_table_4_5(elimination: ParameterElimination) -> list[str]:
    if not set(TABLE_4_5) <= set(elimination.keys):
        return []
    more = ", ".join(symbol(key) for key in elimination.kept if key not in TABLE_4_5)
    fewer = ", ".join(symbol(key) for key in TABLE_4_5 if key not in elimination.kept)
    both = [f"beyond the thesis's 28 (Table 4.5): {more}"] if more else []
    both += [f"of its 28 not kept: {fewer}"] if fewer else []
    return ["; ".join(both) or "these are the thesis's 28 (Table 4.5)"]


def _dependence(model: Model, held: UnidentifiableParameter) -> str:
    """Words for an unidentifiable parameter: `δd1 moves the tip exactly like +0.87 δx_b +0.5 δz_b`."""
    name, (_, scale, unit) = symbol(held.key), screen_unit(model, held.key)
    if held.combination and held.survival <= ALIKE:
        parts = " ".join(
            f"{amount:+.3g} {_unit(model, key)} {symbol(key)}" for key, amount in held.combination[:PARTS_SHOWN]
        )
        less = " and less of others" if len(held.combination) > PARTS_SHOWN else ""
        like = "exactly" if held.survival < 1e-6 else f"but for {in_percent(held.survival)} %"
        return f"1 {_unit(model, held.key)} {name} moves the tip {like} like {parts}{less}"
    if not np.isfinite(held.standard_error):
        return f"{name} does not move the tip at all"
    return f"{name} hardly moves the tip (it would be known to ± {held.standard_error * scale:.3g} {unit})"


def _unit(model: Model, key: str) -> str:
    return model.parameter(key).unit.replace("_per_", "/")


def _values(values: Array) -> str:
    return " ".join(f"{value:.2e}" if value > 1e-9 else "0" for value in values)
