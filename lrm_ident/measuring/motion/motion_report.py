"""Results about motion in words: the documents of `lrm-ident motion`, with the verdicts and renderers of poses."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from lrm_ident.data.wording import enumerate_words, in_percent, joint_labels
from lrm_ident.diagnosis.attribution import support_of, term_of, unexplained_ratio
from lrm_ident.diagnosis.evidence import NO_EVIDENCE
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.measuring.motion.motion_study import JudgedEffect, MotionStudy
from lrm_ident.measuring.motion.moves import Moves
from lrm_ident.measuring.motion.regimes import worst_regimes
from lrm_ident.measuring.motion.screening import JointScreening, MotionCandidate
from lrm_ident.report.diagnosis.conclusion import Conclusion
from lrm_ident.report.diagnosis.standing import Standing
from lrm_ident.report.document import Block, Document, ResultTable, room_below, section
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.text.next_steps import OR, NextStep
from lrm_ident.report.text.verdicts import MISSING
from lrm_ident.residual.thresholds import FLOOR_RATIO, MAX_UNEXPLAINED_RATIO
from lrm_math.effects.base import Parameter
from lrm_math.effects.reference import ParameterRef
from lrm_math.motion.base import MotionEffect

SHOWN, FEWEST, BAR, LISTED = 8, 2, 12, 4
STANDINGS = {
    Support.SUPPORTED: Standing.PARTLY,
    Support.IMPLAUSIBLE: Standing.REFUSED,
    Support.NO_EVIDENCE: Standing.NOTHING,
}
UNDETERMINED = "not determined by these moves"
UNITS = {"rad": (180.0 / np.pi, "deg"), "rad_per_s": (180.0 / np.pi, "deg/s"), "rad_per_s2": (180.0 / np.pi, "deg/s²"),
         "s": (1e3, "ms"), "Hz": (1.0, "Hz"), "ratio": (1.0, ""), "rad_per_rad": (100.0, "%"),
         "rad_per_Nm": (180.0 / np.pi, "deg/N·m")}  # fmt: skip
"""Units in which people read a parameter, by that of its key."""


def in_unit(error: float, moves: Moves) -> str:
    """An error (rad, m) in the moves' unit, two significant digits at least."""
    shown = error * moves.scale
    return f"{shown:.3f} {moves.unit}" if shown < 0.1 else f"{shown:.2f} {moves.unit}"


def _number(error: float, moves: Moves) -> str:
    return in_unit(error, moves).split()[0]


def motion_document(study: MotionStudy, title: str, added: str = "") -> Document:
    """Result of `motion fit` and `add`: errors of every joint and parameters; schema `lrm/motion-fit/1`.

    `added`: name of the effect whose parameters are shown; the others are details.
    """
    errors, parameters = _errors(study, title), parameter_table(study, study.model.effects)
    values = {**_values(study), "joints": errors.records(), "parameters": parameters.records()}
    new = [effect for effect in study.model.effects if effect.name == added]
    blocks = [errors, *([parameter_table(study, new)] if new else [])]
    return Document(blocks, "lrm/motion-fit/1", values, details=[parameters], about="the parameters of all joints")


def comparison_document(study: MotionStudy) -> Document:
    """Result of `motion compare`: errors, and where the model fails; schema `lrm/motion-comparison/1`."""
    errors = _errors(study, f"{study.moves.name}: reading less prediction, {len(study.moves)} moves")
    where = [words for fit in study.fits for words in worst_regimes(fit, study.moves)]
    blocks: list[Block] = [errors, *section("Where it fails", where or ["nowhere much more than elsewhere"])]
    values = {**_values(study), "joints": errors.records(), "where": where}
    return Document(blocks, "lrm/motion-comparison/1", values)


def diagnosis_document(
    study: MotionStudy, screenings: Sequence[JointScreening], model: str = "MODEL", data: str = "RECORDING"
) -> Document:
    """Result of `motion diagnose`; schema `lrm/motion-diagnosis/1`."""
    best, moves, unit = max(screenings, key=lambda screening: screening.saved), study.moves, study.moves.unit
    concluded = _conclusion(study, screenings, best, model, data)
    rows = sorted(
        (candidate for joint in screenings for candidate in joint.candidates if candidate.held_out is not None),
        key=lambda candidate: (candidate.verdict != "supported", -_saved(screenings, candidate)),
    )
    candidates = [
        (
            candidate.effect.name,
            f"{_number(_before(screenings, candidate), moves)} → {_number(candidate.held_out or np.nan, moves)}",
            "█" * max(1, round(BAR * min((candidate.held_out or 0.0) / _before(screenings, candidate), 1.0))),
            _status(screenings, candidate),
        )
        for candidate in rows[:SHOWN]
    ]
    title = "\nHeld-out error of its joint with each candidate added"
    table = ResultTable(("candidate", f"held out, {unit} RMS|", "", "status"), candidates, title)
    blocks = concluded.blocks()
    room = min(room_below(blocks), len(candidates))
    blocks += [replace(table, cells=candidates[:room])] if room >= FEWEST else []
    refused = [
        f"{plain_name(effect.name)} ({effect.name}): {reason}"
        for screening in screenings
        for effect, reason in screening.not_testable
    ]
    values = {
        **_values(study),
        "conclusion": concluded,
        "ranking": [_candidate(screenings, candidate, moves) for candidate in rows],
        "not_testable": [
            {"effect": effect.id, "place": effect.place, "reason": reason}
            for screening in screenings
            for effect, reason in screening.not_testable
        ],
    }
    details = [*([table] if rows else []), *section("What these moves cannot show", refused)]
    about = "every candidate, and what these moves cannot show"
    return Document(blocks, "lrm/motion-diagnosis/1", values, details=details, about=about)


def auto_document(study: MotionStudy, judged: Sequence[JudgedEffect], output: str) -> Document:
    """Result of `motion auto`; schema `lrm/motion-auto/1`."""
    identified = [judged_effect for judged_effect in judged if judged_effect.identified]
    names = enumerate_words([plain_name(judged_effect.effect.name) for judged_effect in identified], LISTED)
    first, last, moves, unit = study.history[0][1], study.history[-1][1], study.moves, study.moves.unit
    ratio = max(fit.held_out_rms / noise for fit, noise in zip(study.fits, study.moves.noise, strict=True))
    if identified:
        headline = f"Identified: {names}"
    elif judged:
        headline = "No cause identified: the added effects predict better, but other causes are possible."
    elif ratio <= FLOOR_RATIO:
        headline = "No missing effect found: the remaining error is about the noise of a reading."
    else:
        headline = "No cause identified. The error is systematic, but no known effect explains it."
    facts = [
        ("held-out error", f"{_number(first, moves)} → {in_unit(last, moves)} RMS {_over(moves)}"),
        ("noise", _noise(study)),
    ]
    if ratio > FLOOR_RATIO:
        facts.append(("unexplained", f"the worst joint is {ratio:.1f} times as far off as the noise of a reading"))
    concluded = Conclusion(headline, tuple(facts), (), (NextStep("Look where it still fails", (_compare(output),)),))
    table = ResultTable(
        ("effect", "size", f"without it, {unit} RMS|", "what it is"),
        [
            (item.effect.name, _size(study, item.effect), _number(item.without, moves), _kind(item)) for item in judged
        ],
        "Effects of the model, and the held-out error of their joint without them",
    )  # fmt: skip
    steps = [f"{step}: {in_unit(error, moves)}" for step, error in study.history]
    blocks = concluded.blocks()
    if judged:
        blocks += ["", table]
    blocks += section("Steps", steps)
    values = {
        **_values(study),
        "conclusion": concluded,
        "effects": [
            {
                "effect": judged_effect.effect.name,
                "kind": term_of(judged_effect.kind, judged_effect.rivals),
                "identified": judged_effect.identified,
                "indistinguishable_from": judged_effect.rivals,
                f"held_out_without_{unit}": judged_effect.without * moves.scale,
            }
            for judged_effect in judged
        ],
    }
    return Document(blocks, "lrm/motion-auto/1", values)


def _conclusion(
    study: MotionStudy, screenings: Sequence[JointScreening], best: JointScreening, model: str, data: str
) -> Conclusion:
    moves = study.moves
    first, files = best.first, f"{shlex.quote(model)} {data}"
    if first is None or first.held_out is None:
        above_noise = [
            screening for screening in screenings if screening.before.held_out_rms > FLOOR_RATIO * screening.noise
        ]
        facts: tuple[tuple[str, str], ...] = (
            ("held-out error", f"{in_unit(study.held_out_rms, moves)} RMS {_over(moves)}"),
            ("noise", _noise(study)),
        )
        if not above_noise:
            words = "No missing effect found: the remaining error is about the noise of a reading."
            return Conclusion(words, facts, (), (NextStep("Nothing to add: use the model"),))
        worst = max(above_noise, key=lambda screening: screening.before.held_out_rms / screening.noise)
        words = f"{worst.before.effects[0].place}, {worst.before.held_out_rms / worst.noise:.1f} times its noise"
        where = NextStep("See where it fails", (f"lrm-ident motion compare {files}",))
        headline = "No cause identified. The error is systematic, but no known effect explains it."
        return Conclusion(headline, (*facts, ("worst", words)), (), (where,))
    name, alike = first.effect.name, [plain_name(effect_name) for effect_name in best.equivalent]
    what = f"{plain_name(name)} ({name})"
    before, after = best.before.held_out_rms, first.held_out
    squares = before**2 - after**2, max(after**2 - (FLOOR_RATIO * best.noise) ** 2, 0.0)
    if not first.effect.names_a_cause:
        headline = f"No cause identified. The best empirical term: {what}"
        certainty = "an empirical term: it improves the prediction; its cause is not identified"
    elif alike:
        headline = f"{MISSING}: {what}, or another that these moves cannot distinguish from it"
        certainty = f"it, or {enumerate_words(alike, LISTED)}: these moves cannot distinguish them"
    elif support_of(*squares, NO_EVIDENCE) != Support.FINDING:
        headline = f"An effect is missing from the model. The best candidate: {what}"
        certainty = (
            f"only a candidate cause: {unexplained_ratio(*squares):.1f} times as much squared error stays unexplained "
            f"as it explains (limit {MAX_UNEXPLAINED_RATIO:.2f}), so another cause may stand behind it, or join it"
        )
    else:
        headline, certainty = (
            f"{MISSING}: {what}",
            f"identified: no other cause explains the error as well{_runner_up(best, moves)}",
        )
    facts = (
        ("estimate", _claim(first)),
        (
            "held-out error",
            f"{_number(before, moves)} → {in_unit(after, moves)} RMS {_of(moves)}, at moves that the fit did not use",
        ),
        ("noise", f"{in_unit(best.noise, moves)} of a reading"),
        ("certainty", certainty),
    )
    steps = (
        NextStep("Add it and refit its joint", (f"lrm-ident motion add {files} {name} -o better.toml",)),
        NextStep("Add all that is missing", (f"lrm-ident motion auto {files} -o best.toml",), OR),
    )
    return Conclusion(headline, facts, (), steps)


def _runner_up(screening: JointScreening, moves: Moves) -> str:
    others = [candidate for candidate in screening.candidates[1:] if candidate.held_out is not None]
    if not others:
        return ""
    least = min(others, key=lambda candidate: candidate.held_out or np.inf)
    return f"; the next best, {plain_name(least.effect.name)}, would leave {in_unit(least.held_out or np.nan, moves)}"


def _claim(candidate: MotionCandidate) -> str:
    values, sigma = candidate.fit.by_key, candidate.fit.sigma
    return ", ".join(
        f"{parameter.meaning} {estimate(parameter, values[key], sigma[key])}"
        for key, parameter in zip(candidate.effect.keys, candidate.effect.parameters, strict=True)
    )


def _size(study: MotionStudy, effect: MotionEffect) -> str:
    rows = zip(effect.keys, effect.parameters, strict=True)
    return ", ".join(estimate(p, study.model.values[key], study.model.sigma.get(key, 0.0)) for key, p in rows)


def estimate(parameter: Parameter, value: float, error: float) -> str:
    """A value (SI) with its standard error, or that the moves do not determine it.

    They do not where no move shows it, where its 95 % interval holds all that the catalogue allows, or, of what is
    never zero, where its error is larger than itself.
    """
    covered = value - 1.96 * error <= parameter.lower and value + 1.96 * error >= parameter.upper
    if error == 0.0 or covered or (parameter.lower > 0.0 and error > value):
        return UNDETERMINED
    factor, name = UNITS.get(parameter.unit, (1.0, parameter.unit.replace("_", " ")))
    digits = max(0, min(4, 1 - int(np.floor(np.log10(max(error * factor, 1e-9))))))
    return f"{value * factor:.{digits}f} ± {error * factor:.{digits}f} {name}".rstrip()


def _kind(judged_effect: JudgedEffect) -> str:
    beside = enumerate_words([plain_name(name) for name in judged_effect.rivals], LISTED)
    term = term_of(judged_effect.kind, judged_effect.rivals)
    return f"{term}, or {beside}" if beside else term


def _errors(study: MotionStudy, title: str) -> ResultTable:
    labels = joint_labels(study.moves.arm) if study.moves.unit == "deg" else ["tip, along an axis"]
    rows = []
    for label, fit, noise in zip(labels, study.told_apart, study.moves.noise.tolist(), strict=False):
        told, unexplained = study.moves.beside_command(fit.effects[0].joint), fit.residual[study.moves.counted]
        errors = (_rms(told), _rms(unexplained), fit.held_out_rms, noise)
        rows.append((label, *(float(value) * study.moves.scale for value in errors)))
    columns = ("joint", *(f"{name}_{study.moves.unit}|.3f" for name in ("command", "fit", "held_out", "noise")))
    return ResultTable(columns, rows, title)


def parameter_table(study: MotionStudy, effects: Sequence[MotionEffect]) -> ResultTable:
    """Estimates of effects in people's units, with standard errors."""
    rows = [
        (plain_name(effect.name), p.meaning, estimate(p, study.model.values[key], study.model.sigma[key]))
        for effect in effects
        for key, p in zip(effect.keys, effect.parameters, strict=True)
    ]  # fmt: skip
    return ResultTable(("effect", "parameter", "estimate"), rows, "Parameters")


def _values(study: MotionStudy) -> dict[str, object]:
    unit, scale = study.moves.unit, study.moves.scale
    return {
        "arm": study.moves.arm.name,
        "recording": study.moves.name,
        "moves": len(study.moves),
        f"held_out_{unit}": study.held_out_rms * scale,
        f"noise_{unit}": study.moves.noise * scale,
        "effects_of_model": [effect.name for effect in study.model.effects],
        "history": [{"step": step, f"held_out_{unit}": error * scale} for step, error in study.history],
    }


def _candidate(screenings: Sequence[JointScreening], candidate: MotionCandidate, moves: Moves) -> dict[str, object]:
    values, sigma = candidate.fit.by_key, candidate.fit.sigma
    return {
        "effect": candidate.effect.id,
        "place": candidate.effect.place,
        "verdict": candidate.verdict,
        f"held_out_{moves.unit}": (candidate.held_out or np.nan) * moves.scale,
        f"before_{moves.unit}": _before(screenings, candidate) * moves.scale,
        "p_value": candidate.p_value,
        "indistinguishable": candidate.effect.name in _screening(screenings, candidate).equivalent,
        "parameters": {
            ParameterRef.parse(key).name: {"value": values[key], "se": sigma[key]} for key in candidate.effect.keys
        },
    }


def _status(screenings: Sequence[JointScreening], candidate: MotionCandidate) -> str:
    screening = _screening(screenings, candidate)
    if candidate is screening.first:
        share = 1.0 - ((candidate.held_out or 0.0) / screening.before.held_out_rms) ** 2
        return f"explains {in_percent(share)} %"
    if candidate.effect.name in screening.equivalent:
        return Standing.LIKE
    return STANDINGS[candidate.verdict]


def _screening(screenings: Sequence[JointScreening], candidate: MotionCandidate) -> JointScreening:
    return next(screening for screening in screenings if any(candidate is other for other in screening.candidates))


def _before(screenings: Sequence[JointScreening], candidate: MotionCandidate) -> float:
    return _screening(screenings, candidate).before.held_out_rms


def _saved(screenings: Sequence[JointScreening], candidate: MotionCandidate) -> float:
    return _before(screenings, candidate) ** 2 - (candidate.held_out or np.inf) ** 2


def _noise(study: MotionStudy) -> str:
    moves = study.moves
    low, high = (in_unit(float(value), moves) for value in (moves.noise.min(), moves.noise.max()))
    return f"{low.split()[0]} to {high} of a reading" if low != high else f"{low} of a reading"


def _over(moves: Moves) -> str:
    return "over all joints" if moves.unit == "deg" else "of the tip along an axis"


def _of(moves: Moves) -> str:
    return "of that joint" if moves.unit == "deg" else _over(moves)


def _rms(values: Iterator[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def _compare(output: str) -> str:
    return f"lrm-ident motion compare {shlex.quote(output)} RECORDING"
