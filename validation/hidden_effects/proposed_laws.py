"""`python -m validation.hidden_effects.proposed_laws`: laws outside the catalogue, and none, through `propose`.

Twelve laws per half, of which the grammar holds some; and arms without a hidden effect, on which no law may be
proposed. The grammar was written with the first half in view, the second one is the report. Counted is whether the
model with the proposed law predicts unseen poses within 1.15 of the noise.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.diagnosis.symbolic_regression.proposal import propose_law
from lrm_ident.fitting.executors import executor_for, in_order
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from validation.hidden_effects.confusion import FLOOR_MM
from validation.hidden_effects.tables import markdown_table, share
from validation.hidden_effects.unfamiliar_data import arm_file, write_data
from validation.hidden_effects.unfamiliar_effects import UnfamiliarCase, hidden, nothing
from validation.synthetic import FormulaJoint

ENOUGH = 1.15
TUNE = {  # formula: (joint, size in rad)
    "np.sin(q[1] + q[4])": (3, 0.02),
    "np.cos(2 * (q[2] - q[5]))": (3, 0.012),
    "np.abs(q[3]) * np.sin(q[1])": (2, 0.012),
    "np.maximum(q[2] + q[3] - 0.8, 0)": (2, 0.03),
    "np.exp(-((q[4] - 0.4) / 0.4) ** 2)": (2, 0.015),
    "np.sin(5 * q[1])": (2, 0.008),
    "tau * np.cos(q[3])": (2, 0.02),
    "torque[2]": (3, 0.1),
    "np.maximum(torque[3], 0)": (2, 0.2),
    # not in the grammar
    "np.tanh(2 * np.sin(q[1] + q[4]))": (3, 0.015),
    "np.sin(q[2] + q[3] - q[5])": (3, 0.02),
    "np.arctan2(np.sin(q[3]), 1.5 + np.cos(q[4]))": (2, 0.02),
    "np.sqrt(1 + q[4] ** 2) * np.cos(q[1])": (2, 0.012),
    "1 / (1 + np.exp(-4 * (q[3] - 0.3 * q[1])))": (2, 0.02),
}
REPORT = {
    "np.cos(q[1] - q[4])": (2, 0.02),
    "np.sin(3 * q[4])": (2, 0.012),
    "np.abs(q[2] + q[5])": (3, 0.015),
    "np.tanh((q[5] + 0.4) / 0.4)": (3, 0.02),
    "np.sin(q[2]) * np.cos(q[4])": (3, 0.025),
    "q[3] * np.abs(q[3])": (2, 0.012),
    # not in the grammar
    "np.sin(q[1] + 0.5 * q[3])": (2, 0.02),
    "np.exp(-(q[2] ** 2) - q[4] ** 2)": (3, 0.03),
    "np.maximum(np.sin(2 * q[3]), 0.2)": (2, 0.02),
    "np.sign(q[1] * q[3])": (2, 0.01),
    "np.log(1 + q[5] ** 2) * np.sin(q[2])": (3, 0.02),
    "1 / (1.5 + np.cos(q[1] + q[3]))": (3, 0.03),
}
HALVES = {"tune": TUNE, "report": REPORT}
FIRST_SEED = {"tune": 0, "report": 100}
LAWS = TUNE | REPORT


@dataclass(frozen=True)
class ProposedLawOutcome:
    """One data set: the truth, the formula proposed ("" for none), and the error at unseen poses over the noise."""

    truth: str
    proposed: str
    before: float
    ratio: float


def law_case(formula: str) -> UnfamiliarCase:
    """The data set of one law."""
    joint, size = LAWS[formula]
    number = list(LAWS).index(formula)
    return hidden("report", f"law-{number}", None, lambda by: FormulaJoint(joint, by.size(size), formula))


def examine_law(law_and_seed: tuple[str, int], poses: int) -> ProposedLawOutcome:
    """Fits offsets and compliance, proposes, and predicts unseen poses. formula: "" for no hidden effect."""
    formula, seed = law_and_seed
    case = law_case(formula) if formula else nothing("report")
    arm = load_arm(str(arm_file(case)))
    with TemporaryDirectory(prefix="law-") as folder:
        data, unseen = (load_measurements(path, arm) for path in write_data(case, seed, poses, Path(folder)))
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    fitted = fit_identifiable(model, data, model.keys).fit.model

    def ratio_of(one: Model) -> float:
        """RMS error at the unseen poses with the noise added, over the noise."""
        left = (unseen.tcp - solve_equilibrium(one, unseen.poses).tcp) * 1e3
        return float(np.sqrt((left**2).sum(axis=1).mean() + FLOOR_MM**2) / FLOOR_MM)

    try:
        best = propose_law(fitted, data).best
    except LrmError as error:
        return ProposedLawOutcome(formula, f"failed: {error}", ratio_of(fitted), float("nan"))
    after = fitted if best is None else best.fit.model
    return ProposedLawOutcome(formula, "" if best is None else best.law.formula, ratio_of(fitted), ratio_of(after))


def _said(done: int, of: int) -> None:
    print(f"{done}/{of}", file=sys.stderr, flush=True)


def main() -> None:
    """Runs all laws and the null data, and prints a table."""
    parser = argparse.ArgumentParser(prog="python -m validation.hidden_effects.proposed_laws", description=__doc__)
    parser.add_argument("--half", choices=HALVES, default="report")
    parser.add_argument("--seeds", type=int, default=1, help="data sets per law")
    parser.add_argument("--null", type=int, default=20, help="data sets without a hidden effect")
    parser.add_argument("--poses", type=int, default=300)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--cluster", help="Dask scheduler; its workers need this repository on their path")
    options = parser.parse_args()
    first = FIRST_SEED[options.half]
    tasks = [(law, seed) for law in HALVES[options.half] for seed in range(first, first + options.seeds)] + [
        ("", seed) for seed in range(first, first + options.null)
    ]
    with executor_for(options.cluster, most=options.jobs) as pool:
        found = in_order(pool, partial(examine_law, poses=options.poses), tasks, _said)
    laws, null = [one for one in found if one.truth], [one for one in found if not one.truth]
    rows = [(one.truth, one.proposed or "–", f"{one.before:.2f}", f"{one.ratio:.2f}") for one in laws]
    print(markdown_table(("hidden", "proposed", "ratio before", "ratio after"), rows))
    print(f"\nwithin {ENOUGH} of the noise: {share(one.ratio <= ENOUGH for one in laws)} of {len(laws)}")
    print(f"a law proposed where nothing is hidden: {share(bool(one.proposed) for one in null)} of {len(null)}")


if __name__ == "__main__":
    main()
