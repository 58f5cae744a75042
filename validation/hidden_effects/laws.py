"""`python -m validation.hidden_effects.laws`: laws outside the catalogue, and none, through `propose`.

Twelve laws per half, of which the grammar holds some; and arms without a hidden effect, on which no law may be
proposed. The grammar was written with the first half in view, the second one is the report. Counted is whether the
model with the proposed law predicts unseen poses within 1.15 of the noise.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.diagnosis.symbolic_regression.proposal import propose_law
from lrm_ident.fitting.executors import executor_for, in_order
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation.hidden_effects.case import REPORT, TUNE, Case, hidden, nothing
from validation.hidden_effects.data import write_data
from validation.hidden_effects.examine import base_model, over_noise
from validation.hidden_effects.outcome import NEAR_NOISE
from validation.hidden_effects.tables import markdown_table, share
from validation.options import asked
from validation.synthetic import FormulaJoint

HALVES = {
    TUNE: {  # formula: (joint, size in rad)
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
    },
    REPORT: {
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
    },
}
FIRST_SEED = {TUNE: 0, REPORT: 100}
LAWS = HALVES[TUNE] | HALVES[REPORT]


@dataclass(frozen=True)
class ProposedLawOutcome:
    """One data set: the truth, the formula proposed ("" for none), and the error at unseen poses over the noise."""

    truth: str
    proposed: str
    before: float
    ratio: float


def law_case(formula: str) -> Case:
    """The data set of one law."""
    (joint, size), number = LAWS[formula], list(LAWS).index(formula)
    return hidden(REPORT, f"law-{number}", None, lambda by: FormulaJoint(joint, by.size(size), formula))


def examine_law(law_and_seed: tuple[str, int], poses: int) -> ProposedLawOutcome:
    """Fits offsets and compliance, proposes, and predicts unseen poses. formula: "" for no hidden effect."""
    formula, seed = law_and_seed
    case = law_case(formula) if formula else nothing(REPORT)
    arm = load_arm(str(case.arm_file))
    with TemporaryDirectory(prefix="law-") as folder:
        data, unseen = (load_measurements(path, arm) for path in write_data(case, seed, poses, Path(folder)))
    fitted = base_model(data, arm)

    def ratio_of(one: Model) -> float:
        return over_noise((unseen.tcp - solve_equilibrium(one, unseen.poses).tcp) * 1e3)

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
    options = asked(
        __doc__,
        half=(REPORT, "which laws", tuple(HALVES)),
        seeds=(1, "data sets per law"),
        null=(20, "data sets without a hidden effect"),
        poses=300,
        jobs=os.cpu_count() or 1,
        cluster=("", "Dask scheduler; its workers need this repository on their path"),
    )
    first = FIRST_SEED[options.half]
    tasks = [(law, first + seed) for law in HALVES[options.half] for seed in range(options.seeds)]
    tasks += [("", first + seed) for seed in range(options.null)]
    with executor_for(options.cluster or None, most=options.jobs) as pool:
        found = in_order(pool, partial(examine_law, poses=options.poses), tasks, _said)
    laws, null = [one for one in found if one.truth], [one for one in found if not one.truth]
    rows = [(one.truth, one.proposed or "–", f"{one.before:.2f}", f"{one.ratio:.2f}") for one in laws]
    print(markdown_table(("hidden", "proposed", "ratio before", "ratio after"), rows))
    print(f"\nwithin {NEAR_NOISE} of the noise: {share(one.ratio <= NEAR_NOISE for one in laws)} of {len(laws)}")
    print(f"a law proposed where nothing is hidden: {share(bool(one.proposed) for one in null)} of {len(null)}")


if __name__ == "__main__":
    main()
