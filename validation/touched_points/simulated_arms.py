"""`python -m validation.touched_points.simulated_arms`: twelve SO-101s, calibrated by sockets alone.

Each is jogged (torque on) until its tip is in a socket: 60 touches, five sockets at three placements; commands are
those of 4096 counts a turn, and the tip sits in a socket within 0.15 mm per axis. Placements and postures are those of
`lrm-ident sockets plan`. A tracker of that noise measures as many poses, planned alike (`--tracker-poses`: fewer). Then
`auto` names what is missing, and both calibrations predict the tip at 100 fresh poses, up to a rigid motion, since
neither where a board nor where a tracker stands is known. Six arms are those of the independent generator.
"""

from __future__ import annotations

import math
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.similarity import similarity
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_ident.measuring.sockets.touch_plan import TouchPlan, plan_touches
from lrm_ident.study import api as lrm
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at, variants
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.motion import recorded
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from validation import synthetic
from validation.options import Count, asked
from validation.runner import run_cases
from validation.synthetic import Deviations, GroundTruth, HiddenEffect
from validation.tables import markdown_table, table_row

ARM_FILE = Path(__file__).resolve().parents[2] / "config" / "arms" / "so101.toml"
ARM = load_arm("so101")
JOINTS = [f"offsets.joint{k}.theta_rad" for k in range(1, ARM.dof + 1)]
LIMITS = np.array([(joint.lower, joint.upper) for joint in ARM.joints]) * 0.99
DEG, COUNT = np.radians(1.0), 2.0 * np.pi / 4096
PLACEMENTS = 3
TOUCHES, FRESH, NOISE_M, MISSED_M = 60, 100, 0.15e-3, 1e-4
HISTORY = 8
GEOMETRY_SD = {"theta_rad": 0.02, "d_m": 0.001, "a_m": 0.001, "alpha_rad": 0.01}
NOTHING = ""
BOTH_GAINS = [f"servo_gain.joint2.g_{side}_rad_per_rad" for side in ("plus", "minus")]
Tips = Callable[[Array, int], Array]
"""True tips (P, 3), m, after straight moves along joint angles (P, n), rad, from touch number `first` on."""


@dataclass(frozen=True)
class Cause:
    """A hidden effect: what it is, names that are right, and the arm that has it, by a seed."""

    words: str
    right: tuple[str, ...]
    tips: Callable[[int], Tips]


def of_generator(*effects: HiddenEffect, compliance: tuple[float, float] = (0.03, 0.06)) -> Callable[[int], Tips]:
    """An arm of the independent generator with random geometry and springs."""

    def drawn(seed: int) -> Tips:
        arm, rng = synthetic.load_arm(ARM_FILE), np.random.default_rng([seed, 65])
        errors = {
            f"joint{k}.{key}": float(rng.normal(scale=sd)) for k in range(1, 6) for key, sd in GEOMETRY_SD.items()
        }
        nominal = GroundTruth.nominal(arm)
        springs = tuple(rng.uniform(*compliance, size=ARM.dof).tolist())
        truth = GroundTruth(Deviations.named(5, errors), nominal.displacements, 0.005, springs, effects)

        def tips(path: Array, first: int) -> Array:
            schedule = synthetic.Schedule(first + np.arange(1.0, len(path) + 1.0), np.ones(len(path)), path[0])
            return np.asarray(synthetic.true_state(arm, truth, path, 0.0, schedule).tcp_m)

        return tips

    return drawn


def of_model(name: str, values: dict[str, float], springs: tuple[float, float] = (0.03, 0.06)) -> Callable[[int], Tips]:
    """An arm of the tool's own model with random geometry, springs, and one effect."""

    def drawn(seed: int) -> Tips:
        rng = np.random.default_rng([seed, 66])
        effects = [
            effect for part in ("offsets", "compliance", *([name] if name else [])) for effect in effects_at(ARM, part)
        ]
        offsets = [effect for effect in effects_at(ARM, "offsets") if effect.place != "base"]
        sizes = {key: p.typical for effect in offsets for key, p in zip(effect.keys, effect.parameters, strict=True)}
        known = {key: 0.3 * float(rng.normal()) * size for key, size in sizes.items()}
        known |= {f"compliance.joint{k}.k_rad_per_Nm": float(rng.uniform(*springs)) for k in range(1, 6)}
        truth = model_of(ARM, effects, known | values)

        def tips(path: Array, first: int) -> Array:
            moves, states = recorded(path, path[0], np.zeros(len(path), dtype=np.bool_))
            number = first + np.arange(1, len(path) + 1)
            poses = Poses(path, np.zeros(len(path)), direction=moves, number=number, friction=states)
            return solve_equilibrium(truth, poses).tcp

        return tips

    return drawn


def cases(touches: int = TOUCHES) -> tuple[Cause, ...]:
    """The twelve arms; what changes does so about the middle of so many touches."""
    part = touches / TOUCHES
    return (
        Cause(
            "play in joint 3 (generator)", ("backlash@joint3",), of_generator(synthetic.SoftPlay(3, 2.0 * DEG, 0.05))
        ),
        Cause(
            "friction that remembers in joint 2 (generator)",
            ("hysteresis@joint2", "friction_curve@joint2"),
            of_generator(synthetic.FrictionLag(2, 1.6 * DEG, 8.0 * DEG)),
        ),
        Cause(
            "gain of servo 3 on one side (generator)",
            ("servo_gain@joint3", "angle_curve@joint3"),
            of_generator(synthetic.OneSidedGain(3, 1, 0.04, 6.0 * DEG)),
        ),
        Cause("sag (generator)", (NOTHING,), of_generator(compliance=(0.08, 0.12))),
        Cause(
            "joint 2 slips (generator)",
            ("change_point@joint2", "change_point@base"),
            of_generator(synthetic.JointSlip(2, 1.5 * DEG, 32.0 * part)),
        ),
        Cause(
            "alien: joint 2 errs by the sum of joints 1 and 3 (generator)",
            (),
            of_generator(synthetic.FormulaJoint(2, 1.2 * DEG, "np.sin(q[1] + q[3])")),
        ),
        Cause(
            "play in joint 2", ("backlash@joint2",), of_model("backlash@joint2", {"backlash.joint2.b_rad": 2.0 * DEG})
        ),
        Cause(
            "hysteresis in joint 3",
            ("hysteresis@joint3", "friction_curve@joint3"),
            of_model("hysteresis@joint3", {"hysteresis.joint3.h_rad": 1.6 * DEG}),
        ),
        Cause(
            "gain of servo 2",
            ("servo_gain@joint2", "angle_curve@joint2"),
            of_model("servo_gain@joint2", dict.fromkeys(BOTH_GAINS, 0.03)),
        ),
        Cause("sag", (NOTHING,), of_model("", {}, springs=(0.08, 0.12))),
        Cause(
            "re-seated tip, 4 mm",
            ("change_point@tool",),
            of_model(
                "change_point@tool",
                {"change_point.tool.before_x_mm": 4e-3, "change_point.tool.last_pose": round(30.0 * part)},
            ),
        ),
        Cause(
            "re-seated tip, 3 mm askew",
            ("change_point@tool",),
            of_model(
                "change_point@tool",
                {
                    "change_point.tool.before_y_mm": 2e-3,
                    "change_point.tool.before_z_mm": 2.3e-3,
                    "change_point.tool.last_pose": round(38.0 * part),
                },
            ),
        ),
    )


CASES = cases()


def joint_step(q: Array, error: Array) -> Array:
    """(n,), rad, change of the joints that moves the tip of the arm as drawn by (3,), m."""
    settled = solve_equilibrium(model_of(ARM, effects_at(ARM, "offsets")), poses_of(q))
    J = parameter_jacobian(settled, JOINTS)[0]
    return np.asarray(np.clip(np.linalg.lstsq(J, error, rcond=0.05)[0], -0.3, 0.3))


@cache
def planned(touches: int, placements: int = PLACEMENTS) -> TouchPlan:
    """The touches that `lrm-ident sockets plan` proposes for an arm as drawn."""
    return plan_touches(ARM, SocketBoard().points, touches, placements, NOISE_M)


def jogged(tips: Tips, path: Array, first: int, goal: Array, begun: Array) -> Array:
    """(n,), rad, the command with which the true tip is in a socket (m) after a path (P, n), jogged from a posture."""
    q = begun
    for _ in range(20):
        tip = tips(np.vstack([path, q]), first)[-1]
        if np.linalg.norm(goal - tip) < 2e-5:
            break
        q = np.clip(q + joint_step(q, goal - tip), *LIMITS.T)
    return q


def touched(tips: Tips, seed: int, touches: int = TOUCHES) -> tuple[Array, list[str], Array, Array]:
    """Commands (N, n), rad, names of the sockets, numbers of the placements, and true tips (N, 3), m.

    A socket into which the tip cannot be jogged from its posture, because a limit is in the way, is left out.
    """
    rng, plan, points = np.random.default_rng([seed, 67]), planned(touches), SocketBoard().points
    motions = [placement.motion(points) for placement in plan.placements]
    path, names, where, seen = np.zeros((0, ARM.dof)), [], [], []
    for begun, name, number in zip(plan.q, plan.points, plan.placement, strict=True):
        goal = (motions[number - 1] @ [*np.array(points[name]) * 1e-3, 1.0])[:3] + rng.normal(0.0, NOISE_M, 3)
        first = max(0, len(path) - HISTORY)
        q = jogged(tips, path[first:], first, goal, begun)
        tip = tips(np.vstack([path[first:], q]), first)[-1]
        if np.linalg.norm(goal - tip) > MISSED_M:
            continue
        path = np.vstack([path, q])
        names.append(name)
        where.append(number)
        seen.append(tip)
    return np.round(path / COUNT) * COUNT, names, np.array(where), np.array(seen)


def loaded(folder: Path, q: Array, columns: dict[str, list[str]], beside: str) -> Measurements:
    """Measurements as the tool reads them from a file."""
    header = ["pose", *(f"q{k}_deg" for k in range(1, ARM.dof + 1)), *columns]
    rows = [[str(n), *(f"{x:.5f}" for x in np.degrees(row)), *(column[n - 1] for column in columns.values())]
            for n, row in enumerate(q, start=1)]  # fmt: skip
    path = folder / "data.csv"
    path.write_text("\n".join(",".join(row) for row in [header, *rows]) + "\n")
    path.with_suffix(".toml").write_text(beside)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return lrm.load(path, "so101")


def identified(data: Measurements, most: int) -> tuple[tuple[str, ...], str, Study]:
    """Names added by `auto`, its last verdict, and the study."""
    run, study = Study.of(data).fit().auto(most)
    return tuple(step.added for step in run.steps[1:]), run.report.verdict, study


def fresh_poses(rng: np.random.Generator) -> Array:
    """(FRESH, n), rad, of the whole workspace before the arm and above the table."""
    q, drawn = np.zeros((0, ARM.dof)), model_of(ARM, ())
    while len(q) < FRESH:
        one = rng.uniform(*(0.6 * LIMITS.T))
        x, _, z = solve_equilibrium(drawn, poses_of(one)).tcp[0]
        if z > 0.02 and x > 0.08:
            q = np.vstack([q, one])
    return q


def deployed_poses(q: Array) -> Poses:
    """Straight moves along joint angles (N, n), rad, without a load."""
    moves, states = recorded(q, q[0], np.zeros(len(q), dtype=np.bool_))
    return Poses(q, np.zeros(len(q)), direction=moves, number=np.arange(1, len(q) + 1), friction=states)


def tip_error_mm(study: Study, tips: Tips, seed: int) -> float:
    """RMS (mm) at fresh poses, up to a rigid motion."""
    q = fresh_poses(np.random.default_rng([seed, 68]))
    true = tips(q, 1000)
    found = solve_equilibrium(as_deployed(study.model), deployed_poses(q)).tcp
    motion = similarity(found, true, np.ones(len(q)), mirrored=False, scale=1.0)
    return 1e3 * error_stats(motion.apply(found) - true).rms


def socket_measurements(tips: Tips, seed: int, count: int, folder: Path) -> Measurements:
    """So many touches, as the tool reads them."""
    q, names, where, _ = touched(tips, seed, count)
    columns = {"point": names, "placement": [f"p{k}" for k in where]}
    return loaded(folder, q, columns, SocketBoard().metadata("so101"))


def tracker_measurements(tips: Tips, seed: int, count: int, folder: Path) -> Measurements:
    """The poses of so many touches, measured by a tracker of the same noise, as the tool reads them."""
    q, _, _, seen = touched(tips, seed, count)
    noisy = 1e3 * (seen + np.random.default_rng([seed, 69]).normal(0.0, NOISE_M, seen.shape))
    columns = {f"{axis}_mm": [f"{value:.4f}" for value in noisy[:, k]] for k, axis in enumerate("xyz")}
    return loaded(folder, q, columns, 'schema = "lrm/measurements/1"\narm = "so101"\n')


@dataclass(frozen=True)
class CalibrationOutcome:
    """One arm: what `auto` adds by sockets, its verdict and whether the names are right, honest or wrong, what it adds
    by a tracker, and both errors of the tip (mm RMS); or why there is no result."""

    words: str
    added: tuple[str, ...] = ()
    verdict: str = ""
    said: str = ""
    by_tracker: tuple[str, ...] = ()
    sockets_mm: float = math.nan
    tracker_mm: float = math.nan
    trouble: str = ""

    @property
    def row(self) -> tuple[str, ...]:
        """A line of the table."""
        if self.trouble:
            return self.words, self.trouble, *[""] * (len(COLUMNS) - 3)
        names = [", ".join(one) or "-" for one in (self.added, self.by_tracker)]
        numbers = (f"{value:.2f}" for value in (self.sockets_mm, self.tracker_mm, self.sockets_mm / self.tracker_mm))
        return self.words, f"{names[0]} ({self.verdict})", self.said, names[1], *numbers


COLUMNS = ("case", "hidden", "by sockets (verdict)", "name", "by tracker", "sockets mm", "tracker mm", "ratio")


def calibrated_case(seed: int, most: int, counts: tuple[int, int], number: int) -> CalibrationOutcome:
    """The case of a number from 1; counts are touches and the tracker's poses."""
    touched_arm, tracked_arm = (cases(count)[number - 1] for count in counts)
    tips, tracked_tips = touched_arm.tips(seed + number), tracked_arm.tips(seed + number)
    try:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            touches = socket_measurements(tips, seed + number, counts[0], folder)
            added, verdict, study = identified(touches, most)
            others, _, other = identified(tracker_measurements(tracked_tips, seed + number, counts[1], folder), most)
        errors = tip_error_mm(study, tips, seed + number), tip_error_mm(other, tracked_tips, seed + number)
    except NoEquilibrium as error:
        return CalibrationOutcome(touched_arm.words, trouble=str(error))
    first = added[0] if added else NOTHING
    found = effects_at(ARM, first) if first else ()
    forms = variants(found[0]) if found else ()
    named = bool({first, *forms} & {*touched_arm.right})
    honest = not added or any(verdict == word for word in ("effect_describes", "unexplained_structure"))
    said = "right" if named else "honest" if honest else "WRONG"
    return CalibrationOutcome(touched_arm.words, added, verdict, said, others, *errors)


def main() -> None:
    """Prints a row for each arm, and the counts."""
    options = asked(
        __doc__,
        seed=1,
        only=("", "numbers of cases by commas"),
        most=(2, "effects that auto may add"),
        touches=Count(TOUCHES),
        tracker_poses=(0, "poses that the tracker measures; 0: as many as touches"),
        jobs=1,
    )
    counts = options.touches, options.tracker_poses or options.touches
    only = [word for word in options.only.split(",") if word]
    chosen = [number for number in range(1, len(CASES) + 1) if not only or str(number) in only]
    examine = partial(calibrated_case, options.seed, options.most, counts)
    found = run_cases({str(number): number for number in chosen}, examine, _line, options.jobs)
    print(markdown_table(COLUMNS, [(key, *one.row) for key, one in found.items()]))
    done = [one for one in found.values() if not one.trouble]
    honest = sum(one.said != "WRONG" for one in done)
    near = sum(one.sockets_mm <= 1.5 * one.tracker_mm for one in done)
    sockets, tracker = (
        float(np.sqrt(np.mean(np.square([getattr(one, key) for one in done])))) for key in ("sockets_mm", "tracker_mm")
    )
    print(
        f"{honest} of {len(chosen)} named right or honest; {near} of {len(chosen)} within 1.5 times the tracker's error"
    )
    print(f"all arms, mm RMS: {sockets:.3f} by sockets, {tracker:.3f} by the tracker, {sockets / tracker:.2f} times")


def _line(key: str, one: CalibrationOutcome) -> str:
    return table_row((key, *one.row))


if __name__ == "__main__":
    main()
