"""Measurements of an upright arm with errors everywhere, by the independent generator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.robot_files.arm_text import template
from lrm_ident.data.source import Source
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import Model
from validation import synthetic
from validation.synthetic.generate import directions


def upright_measurements(
    folder: Path,
    seed: int,
    count: int,
    noise: float,
    hidden: tuple[synthetic.HiddenEffect, ...] = (),
    softness: float = 1.0,
    text: str = template("upright"),
) -> tuple[Model, Measurements]:
    """The nominal model and `count` random poses, one after the other, with a noise (m per axis) that is stated.

    Args:
        softness: what the joints' compliances are multiplied by. text: of the arm's file.
    """
    file = folder / "arm.toml"
    file.write_text(text)
    arm = synthetic.load_arm(file)
    truth = synthetic.base_displacement_to_deviations(arm, synthetic.GroundTruth.random(arm, seed, hidden))
    soft = tuple(softness * compliance for compliance in truth.joint_compliance_rad_per_nm)
    truth = replace(truth, joint_compliance_rad_per_nm=soft)
    q, load = synthetic.random_poses(arm, count, seed, floor_m=-1.0), np.zeros(count)
    plan = synthetic.even_schedule(*q.shape)
    tcp = synthetic.measure(arm, truth, q, load, noise, seed, plan)
    poses = Poses(q, load, directions(q, plan.start_q_rad), plan.time_s)
    data = Measurements.of_tcp(poses, tcp, noise, source=Source(file.with_suffix(".csv")))
    return nominal_model(load_arm(str(file))), data
