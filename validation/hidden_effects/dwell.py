"""`python -m validation.hidden_effects.dwell`: dwell times of a design, followed by the independent generator.

Poses are designed that tell creep of a joint from its compliance. Arms that creep, at several time constants, and arms
that do not are measured at them: once held as the design says, once all at the usual pace. Each is diagnosed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import lrm_ident as lrm
from lrm_ident.design.advice import next_poses
from lrm_ident.design.candidate_poses import ClearanceRules, clear_poses
from lrm_ident.design.pose_design import DesignProblem, PoseDesign
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm as load_fitted_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.history import PACE_S
from validation.hidden_effects.case import ARM_FILE, Case, nothing
from validation.hidden_effects.data import FLOOR_M, NOISE_M, true_arm
from validation.hidden_effects.examine import base_model
from validation.hidden_effects.memory import WORLDS
from validation.options import asked
from validation.synthetic import Schedule, load_arm, simulate
from validation.synthetic.files import write

RIVALS = ("creep@joint2", "compliance@joint2")
COUNT, REPEATS = 50, 5


def designed(seed: int) -> PoseDesign:
    """The poses, and how long to hold each, of the nominal arm."""
    arm = load_fitted_arm(str(ARM_FILE))
    rivals = tuple(effect for name in RIVALS for effect in effects_at(arm, name))
    problem = DesignProblem(nominal_model(arm), None, rivals, COUNT, "O1", NOISE_M, None, REPEATS, 1, seed)
    return next_poses(problem, [lambda: clear_poses(arm, (), (0.0,), ClearanceRules(floor=FLOOR_M), seed)])[1]


def named(case: Case, seed: int, plan: PoseDesign, hold: Array) -> Sequence[str]:
    """Names of the first candidate and of those that these poses cannot tell from it; none where nothing is found."""
    described, q = load_arm(case.arm_file), plan.poses.q
    schedule = Schedule(np.cumsum(PACE_S + hold), np.ones(len(q)), np.zeros(q.shape[1]))
    data = simulate(described, true_arm(case, seed, described), q, plan.poses.payload, NOISE_M, seed, schedule)
    with TemporaryDirectory(prefix="dwell-") as folder:
        table = write(Path(folder) / "measured", data, "synthetic: validation.hidden_effects.dwell")[0]
        measured = lrm.load(table, str(case.arm_file))
    first = build_report(diagnose(base_model(measured, load_fitted_arm(str(case.arm_file))), measured)).first
    return () if first is None else (first.name, *first.equivalent)


def main() -> None:
    """Prints what each diagnosis names."""
    options = asked(__doc__, seeds=1)
    worlds = [case for case in WORLDS if case.truth == (RIVALS[0],)] + [nothing("dwell")]
    for seed in range(options.seeds):
        plan = designed(seed)
        print(f"seed {seed}: half of {len(plan.hold)} poses held for {plan.dwell:g} s; {dict(plan.trials)}", flush=True)
        for case in worlds:
            for words, hold in (("held", plan.hold), ("not held", np.zeros_like(plan.hold))):
                print(f"{case.name}, {words}: {', '.join(named(case, seed, plan, hold)) or 'nothing'}", flush=True)


if __name__ == "__main__":
    main()
