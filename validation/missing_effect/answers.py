"""Answers to the benchmark, ours and a naive baseline's: `python -m validation.missing_effect.answers`.

Ours are the effects that `auto` takes for causes, each with those that it calls indistinguishable from it; steps that
only describe are no answer. The baseline regresses the residual of the fit on all candidate effects at once, by ridge,
and names the one with the largest standardised coefficient.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

import lrm_ident as lrm
from lrm_ident.study.study import Study
from lrm_math.effects import CATALOGUE, effects_at
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation.missing_effect.score import DATA, EFFECTS, read_truth, scores
from validation.proofs.result_file import FOLDER, computed, write

ANSWERS = Path(__file__).with_name("answers")
COLUMNS = ("data set", "hidden", "by", "named", "right", "missed", "false")
RIDGE = 1e-6
"""Of the largest eigenvalue of the standardised columns."""
Answers = dict[str, list[list[str]]]


def our_answer(study: Study) -> list[list[str]]:
    """Causes that `auto` finds, each with its class."""
    run, _ = study.auto()
    steps = [step for step in run.steps if step.added and not step.describes]
    return [[name for name in step.names if name.partition("@")[0] in EFFECTS] for step in steps]


def naive_answer(study: Study) -> list[list[str]]:
    """The candidate with the largest standardised coefficient of one linear fit."""
    fitted = study.model
    present = {effect.name for effect in fitted.effects}
    candidates = [
        effect
        for kind in CATALOGUE
        if kind.id in EFFECTS
        for effect in effects_at(fitted.arm, kind.id)
        if effect.name not in present
    ]
    known = {key: fitted.value(key) for key in fitted.keys}
    extended = model_of(fitted.arm, (*fitted.effects, *candidates), known)
    settled = solve_equilibrium(extended, study.data.poses)
    J = parameter_jacobian(settled)
    A = J.reshape(-1, J.shape[2])
    sizes = np.linalg.norm(A, axis=0)
    moved = sizes > 0.0
    Z = A[:, moved] / sizes[moved]
    gram = Z.T @ Z
    gram += RIDGE * np.linalg.eigvalsh(gram)[-1] * np.eye(len(gram))
    coefficients = np.zeros(len(sizes))
    coefficients[moved] = np.abs(np.linalg.solve(gram, Z.T @ (study.data.tcp - settled.tcp).ravel()))
    owner = {
        key: effect.name
        for effect, span in zip(extended.effects, extended.spans, strict=True)
        for key in extended.keys[span]
    }
    names = [owner[key] for key in extended.keys]
    largest = max((i for i, name in enumerate(names) if name not in present), key=lambda i: coefficients[i])
    return [[names[largest]]]


def main() -> None:
    """Writes both answers, and their scores for the page of the documentation."""
    parser = argparse.ArgumentParser("python -m validation.missing_effect.answers", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=FOLDER / "benchmark.json")
    options = parser.parse_args()
    truth = read_truth()
    studies = {name: Study.of(lrm.load(DATA / f"{name}.csv")).fit() for name in truth}
    answers: dict[str, Answers] = {
        "naive baseline": {name: naive_answer(study) for name, study in studies.items()},
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
