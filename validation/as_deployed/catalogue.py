"""Worlds of the catalogues of hidden effects, and twenty more of session, tracker and base.

Measured poses take 75 minutes however many they are, so that what happens at a time happens while measuring; fresh
ones follow every 15 s.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_math.arrays import Array
from validation.as_deployed.half_range import HalfRange
from validation.as_deployed.recording import FRESH, WorldPlan, WorldRecording, recorded
from validation.hidden_effects.case import DEG, FIRST_SEED, Case, hidden, of_part, stable_seed, together
from validation.hidden_effects.cases import CASES, SINGLE
from validation.hidden_effects.catalogue import UNFAMILIAR
from validation.hidden_effects.data import BREAK_S, drawn_poses, true_arm, with_outliers_of
from validation.synthetic import (
    LiftingBase,
    Schedule,
    SkewTracker,
    load_arm,
)
from validation.synthetic.hidden_links import LooseBase, RockingFeet
from validation.synthetic.hidden_tracker import DepthTracker, FoamMat, LensTracker

MEASURING_S, PACE_S = 4500.0, 15.0
LEVEL = np.zeros(3)
PHYSICAL = (FoamMat,)


def recording_of(
    case: Case, seed: int, poses: int, half: HalfRange | None = None, gravity_turn_rad: Array = LEVEL
) -> WorldRecording:
    """The world of a case, measured at so many poses; its true arm as in the catalogue with this seed.

    half: of a joint's range that alone is measured; fresh poses lie in the other. gravity_turn_rad: (3,), rotation
    vector by which gravity is tilted in the frame of measurement.
    """
    number, arm = FIRST_SEED[case.part] + seed, load_arm(case.arm_file).tilted(gravity_turn_rad)
    truth = true_arm(case, number, arm)
    seeds = [stable_seed(case.name, number, what) for what in ("poses", "fresh", "loads", "noise")]
    measured, fresh = (drawn_poses, drawn_poses) if half is None else (half.poses, half.other.poses)
    q = np.vstack([measured(case, arm, seeds[0], poses), fresh(case, arm, seeds[1], FRESH)])
    load = np.random.default_rng(seeds[2]).choice(case.loads_kg, size=len(q))
    plan = WorldPlan(q, load, continued_schedule(poses, case.sessions, q.shape[1]), poses)
    run = recorded(case.arm_file, arm, truth, plan, seeds[3], PHYSICAL)
    return _with_outliers(run, case.outliers, stable_seed(case.name, number, "outliers"))


def continued_schedule(poses: int, sessions: int, joints: int) -> Schedule:
    """Measured poses in sessions of equal length with a break between them, then fresh ones in the last session."""
    before = np.floor(np.arange(poses) * sessions / poses)
    time = MEASURING_S / poses * np.arange(1, poses + 1) + BREAK_S * before
    fresh = time[-1] + PACE_S * np.arange(1, FRESH + 1)
    session = np.append(before, np.full(FRESH, before[-1])) + 1.0
    return Schedule(np.append(time, fresh), session, np.zeros(joints))


def _with_outliers(run: WorldRecording, share: float, seed: int) -> WorldRecording:
    """The recording with a share of its measured positions out by some millimetres, and a fit that expects it."""
    if not share:
        return run
    tcp = run.whole.tcp_m.copy()
    rng = np.random.default_rng(seed)
    tcp[: run.measured] = with_outliers_of(tcp[: run.measured], round(share * run.measured), rng)
    return replace(run, whole=replace(run.whole, tcp_m=tcp), loss="huber")


def _first(case: Case) -> Case:
    taken = of_part("tune", case)
    return replace(taken, truths=None) if case.truth is None else taken


def _pairs() -> dict[str, Case]:
    """Ten worlds with two effects of session or tracker together."""
    names = (
        "warm2+restart1 warm4+slip2 slip4+restart3 warm-base+warm2 warm-base+restart1 "
        "stretched+warm2 leaning+restart3 stretched+slip2 warm2+warm4 stretched+warm-base"
    )
    return {name: _first(together(*(SINGLE[part] for part in name.split("+")))) for name in names.split()}


def _trackers_and_bases() -> dict[str, Case]:
    """Ten worlds with a distorted tracker, or a base that rocks between its feet."""
    zero = (0.0, 0.0, 0.0)
    frame, base = "measurement_frame@frame", "base_compliance@base"
    along_one = f"depth_scale@frame {frame}"
    long_z = hidden("report", "long-z", along_one, lambda by: SkewTracker(zero, (0.0, 0.0, by.size(0.006)), zero))
    wide = hidden(
        "report", "wide-xy", frame, lambda by: SkewTracker(zero, (by.size(0.008), -by.size(0.006), 0.0), zero)
    )
    sheared = hidden(
        "report", "sheared", frame, lambda by: SkewTracker(zero, zero, (0.0, by.sign() * by.size(0.007), 0.0))
    )
    lens = hidden("report", "lens", frame, lambda by: LensTracker(by.sign() * by.size(0.010)))
    depth = hidden("report", "depth", along_one, lambda by: DepthTracker((1.5, -1.0, 0.8), by.size(0.03)))
    loose = hidden("report", "loose-base-y", base, lambda by: LooseBase(0, by.size(0.5 * DEG)))
    rocks_x = hidden("report", "feet-x", base, lambda by: RockingFeet((1.0, 0.0, 0.0), by.size(0.4 * DEG), 0.05))
    rocks_d = hidden("report", "feet-xy", base, lambda by: RockingFeet((0.6, 0.8, 0.0), by.size(0.4 * DEG), 0.1))
    lifts = hidden("report", "lifts-y", base, lambda by: LiftingBase((0.0, 1.0, 0.0), by.size(0.04), 0.05, 0.05))
    ten = (long_z, wide, sheared, lens, depth, loose, rocks_x, rocks_d, lifts, together(wide, rocks_x))
    return {case.name: case for case in ten}


CATALOGUE: dict[str, Case] = (
    {f"first/{name}": _first(case) for name, case in CASES.items()}
    | {f"second/{name}": case for name, case in UNFAMILIAR.items()}
    | {f"pair/{name}": case for name, case in _pairs().items()}
    | {f"frame/{name}": case for name, case in _trackers_and_bases().items()}
)
