"""Answers to the benchmark, ours and those of two naive baselines: `python -m validation.missing_effect.answers`.

Ours are the effects that `auto` takes for causes, each with those that it calls indistinguishable from it; steps that
only describe are no answer. The naive baselines take the residual of the fit: one regresses it on all candidate effects
at once, by ridge, and names the one with the largest standardised coefficient; the other names the one whose column
correlates best with it. Both always name one.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

import lrm_ident as lrm
from lrm_ident.study.study import Study
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, effects_at
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.missing_effect.score import DATA, EFFECTS, read_truth, scores
from validation.options import asked
from validation.proofs.result_file import FOLDER, computed, write

ANSWERS = Path(__file__).with_name("answers")
COLUMNS = ("data set", "hidden", "by", "named", "right", "missed", "false")
RIDGE, LEAST_SHARE = 1e-3, 1e-6
"""Added to the squares of columns of length one; share of a column that the fit must leave for it to count."""
Answers = dict[str, list[list[str]]]


def our_answer(study: Study) -> list[list[str]]:
    """Causes that `auto` finds, each with its class."""
    run, _ = study.auto()
    steps = [step for step in run.steps if step.added and not step.evidence.describes]
    return [[name for name in step.names if EffectRef.parse(name).id in EFFECTS] for step in steps]


def linear_answers(study: Study) -> tuple[list[list[str]], list[list[str]]]:
    """The candidate with the largest coefficient of one linear fit, and the one that correlates best on its own.

    Columns of the candidates, and the residual, are orthogonal to those of the fit, and of length one.
    """
    fitted = study.model
    present = {effect.name for effect in fitted.effects}
    places = [effect for name in EFFECTS for effect in effects_at(fitted.arm, name) if effect.name not in present]
    known = {key: fitted.value(key) for key in fitted.keys}
    extended = model_of(fitted.arm, (*fitted.effects, *places), known)
    settled = solve_equilibrium(extended, study.data.poses)
    J = parameter_jacobian(settled)
    columns, residual = J.reshape(-1, J.shape[2]), (study.data.tcp - settled.tcp).ravel()
    own = sum(len(extended.keys[span]) for span in extended.spans[: len(fitted.effects)])
    basis = np.linalg.svd(_of_length_one(columns[:, :own]), full_matrices=False)[0]
    beyond = columns[:, own:] - basis @ (basis.T @ columns[:, own:])
    seen = np.linalg.norm(beyond, axis=0) > LEAST_SHARE * np.linalg.norm(columns[:, own:], axis=0).clip(1e-300)
    Z = np.where(seen, _of_length_one(beyond), 0.0)
    together = np.abs(np.linalg.solve(Z.T @ Z + RIDGE * np.eye(Z.shape[1]), Z.T @ residual))
    alone = np.abs(Z.T @ residual)
    spans = zip(extended.effects, extended.spans, strict=True)
    names = [effect.name for effect, span in spans for _ in extended.keys[span]][own:]
    return [[names[int(np.argmax(together))]]], [[names[int(np.argmax(alone))]]]


def _of_length_one(columns: Array) -> Array:
    return np.asarray(columns / np.linalg.norm(columns, axis=0).clip(1e-300))


def main() -> None:
    """Writes both answers, and their scores for the page of the documentation."""
    options = asked(__doc__, out=FOLDER / "benchmark.json")
    truth = read_truth()
    studies = {name: Study.of(lrm.load(DATA / f"{name}.csv")).fit() for name in truth}
    naive = {name: linear_answers(study) for name, study in studies.items()}
    answers: dict[str, Answers] = {
        "largest coefficient": {name: one for name, (one, _) in naive.items()},
        "best correlation": {name: one for name, (_, one) in naive.items()},
        "lrm-ident auto": {name: our_answer(study) for name, study in studies.items()},
    }
    ANSWERS.mkdir(exist_ok=True)
    rows: list[tuple[object, ...]] = []
    for by, given in answers.items():
        (ANSWERS / f"{by.replace(' ', '-')}.json").write_text(json.dumps(given, indent=1) + "\n", encoding="utf-8")
        for name, one in scores(given, truth).items():
            rows.append((name, _words(truth[name]), by, _words(given[name]), one.right, one.missed, one.false))
    write(options.out, computed(COLUMNS, rows))


def _words(effects: list[list[str]]) -> str:
    return ", ".join(" or ".join(names) for names in effects) or "nothing"


if __name__ == "__main__":
    main()
