"""`python -m validation.residual_field.acceptance`: what folds say of a field's gain, and what new poses say.

Arms with two effects outside the catalogue, measured as the demo does, named by `auto`; a field is learned whether it
helps or not. Its gain on held-out poses, in folds drawn at random and in blocks of joint space, stands beside its gain
at 2000 new poses by the independent generator's arm, without noise. Seeds from 100: those of the loops begin at 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.demo.pose_files import LOAD_G, clear_poses
from examples.demo.simulated_tracker import REST_SD_M
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import held_out_blocks, random_folds
from lrm_ident.fitting.field.fit import blocks_with_field, fit_with_field
from lrm_ident.fitting.held_out import held_out_residual
from lrm_ident.residual.better_prediction import paired_z
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import GRAM, load_arm
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from validation.hidden_effects.data import ARM_FILE, true_arm
from validation.options import asked
from validation.residual_field.closed_loop import unfamiliar
from validation.synthetic import load_arm as load_true_arm
from validation.synthetic import true_state

POSES, NEW = 240, 2000


@dataclass(frozen=True)
class PairedErrors:
    """Errors (N, 3) of the same poses with names alone and with a field too (m)."""

    without: Array
    with_field: Array

    @property
    def share(self) -> float:
        """Share of the RMS that the field takes."""
        return 1.0 - error_stats(self.with_field).rms / error_stats(self.without).rms

    @property
    def words(self) -> str:
        """RMS without and with it in mm, the share, z of the paired difference."""
        rms = [f"{1e3 * error_stats(error).rms:.2f}" for error in (self.without, self.with_field)]
        squares = [(error**2).sum(axis=1) for error in (self.with_field, self.without)]
        return f"{rms[0]} to {rms[1]} | {100.0 * self.share:.0f} % | {paired_z(squares[0], squares[1]):.1f}"


def true_tips(seed: int, q: Array, payload: Array) -> Array:
    """(N, 3), m, of the arm of a seed at commands (N, n) in rad with loads (N,) in kg."""
    arm = load_true_arm(ARM_FILE)
    return np.asarray(true_state(arm, true_arm(unfamiliar(seed), seed, arm), q, payload).tcp_m)


def simulated_measurements(seed: int, poses: int) -> Measurements:
    """Poses that keep clear of everything, the first half without a load, with the error of a tracker's rest."""
    arm, rng = load_arm("lrm-lab"), np.random.default_rng([seed, 7])
    q, number = clear_poses(arm, poses, rng), np.arange(1, poses + 1)
    payload = np.where(number <= poses // 2, 0.0, LOAD_G * GRAM)
    tcp = true_tips(seed, q, payload) + rng.normal(scale=REST_SD_M, size=(poses, 3))
    made = f"{seed}-{poses}"
    return Measurements(poses_of(q, payload), number, tcp, None, REST_SD_M, number, Path("none"), made, arm=arm)


def paired_errors(seed: int, poses: int) -> Iterator[PairedErrors]:
    """Errors in folds at random, in blocks of joint space, and at new poses."""
    study = Study.of(simulated_measurements(seed, poses)).fit().auto()[1]
    data, arm = study.data, study.model.arm
    for fold in (random_folds(data.poses.q, data.repeat_of), None):
        blocks = held_out_blocks(study.model, data, fold=fold)
        field = ResidualField(arm, "tool")
        yield PairedErrors(held_out_residual(blocks), held_out_residual(blocks_with_field(field, data, blocks)))
    q = clear_poses(arm, NEW, np.random.default_rng([seed, 9]))
    payload = np.full(NEW, LOAD_G * GRAM)
    tips, new = true_tips(seed, q, payload), poses_of(q, payload)
    models = study.model, fit_with_field(study.taken.fit, data).model
    without, with_field = (tips - solve_equilibrium(model, new).tcp for model in models)
    yield PairedErrors(without, with_field)


def main() -> None:
    """Prints one line a seed."""
    known = asked(__doc__, first=(100, "seed to begin with"), seeds=(20, "how many"), poses=POSES)
    print("| seed | hidden | at random, RMS mm | gain | z | blocks | gain | z | new poses | gain | z |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for seed in range(known.first, known.first + known.seeds):
        words = " | ".join(errors.words for errors in paired_errors(seed, known.poses))
        print(f"| {seed} | {unfamiliar(seed).name} | {words} |", flush=True)


if __name__ == "__main__":
    main()
