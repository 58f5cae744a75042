"""`python -m validation.extrapolation`: every form, fitted on half of each joint's range, predicts the other half.

Arms in the proportions of a UR5 with the errors of the independent generator, among them waves in a gear that no plain
effect has. Each is fitted on poses whose joints all stay in the lower half of their range, once with offsets and
compliances, once with every other form as well (at two joints, links and pairs, and at the base), and predicts poses
whose joints are all in the upper half, and poses anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arm import arm_file
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import FREE_FORMS, Effect, effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from validation import synthetic
from validation.options import asked
from validation.synthetic.generate import directions

ARM_FILE = Path(__file__).resolve().parent / "hidden_effects" / "arms" / "ur5-like.toml"
ARMS, POSES, NOISE = 10, 250, 2e-4
WAVES, WAVE_RAD = (3, 7), (0.002, 0.006)
PLACES = ("base", "link2", "link3", "joint2", "joint4", "joint3<-joint2", "joint5<-joint4", "joint2+joint3")
PLAIN = ("offsets", "compliance")


@dataclass(frozen=True)
class ExtrapolationOutcome:
    """One arm: errors (m) beyond the range without forms and with all, anywhere, and of the nominal arm anywhere.

    parameters: fitted, without forms and with all.
    """

    seed: int
    parameters: tuple[int, int]
    beyond: tuple[ErrorStats, ErrorStats]
    anywhere: tuple[ErrorStats, ErrorStats]
    nominal: ErrorStats

    @property
    def worse(self) -> float:
        """RMS error beyond the range with forms over that without."""
        return self.beyond[1].rms / self.beyond[0].rms

    @property
    def farthest(self) -> float:
        """Largest error anywhere, with forms, over the nominal arm's."""
        return self.anywhere[1].max / self.nominal.max


def examine(seed: int, poses: int = POSES, forms: Sequence[type[Effect]] = FREE_FORMS) -> ExtrapolationOutcome:
    """Simulates an arm, fits it on one half, and predicts the rest."""
    arm, described = arm_file.load_arm(ARM_FILE), synthetic.load_arm(ARM_FILE)
    rng = np.random.default_rng([seed, 31])
    ripples = [
        synthetic.ToothRipple(joint, int(rng.integers(*WAVES)), rng.uniform(*WAVE_RAD), rng.uniform(0.0, 6.0))
        for joint in (2, 4)
    ]
    truth = synthetic.GroundTruth.random(described, seed, tuple(ripples))
    lower, middle, upper = _thirds(arm)
    data = _measured(arm, described, truth, rng.uniform(lower, middle, (poses, arm.dof)), seed)
    beyond = _measured(arm, described, truth, rng.uniform(middle, upper, (poses, arm.dof)), None)
    anywhere = _measured(arm, described, truth, rng.uniform(lower, upper, (5 * poses, arm.dof)), None)
    plain = _fitted(arm, data, ())
    every = _fitted(arm, data, [effect for kind in forms for effect in effects_of(kind, arm)], plain)
    return ExtrapolationOutcome(
        seed,
        (len(plain.free), len(every.free)),
        (_error(plain, beyond), _error(every, beyond)),
        (_error(plain, anywhere), _error(every, anywhere)),
        _error(model_of(arm, ()), anywhere),
    )


def effects_of(kind: type[Effect], arm: Arm) -> list[Effect]:
    """A form at the base, at some links, joints and pairs of joints."""
    return [kind(arm, place) for place in kind.places(arm) if place in PLACES]


def _thirds(arm: Arm) -> tuple[Array, Array, Array]:
    """Lower limits, middles and upper limits of the joints (rad)."""
    lower, upper = (np.array([getattr(joint, end) for joint in arm.joints]) for end in ("lower", "upper"))
    return lower, 0.5 * (lower + upper), upper


def _measured(
    arm: Arm, described: synthetic.ArmDescription, truth: synthetic.GroundTruth, q: Array, seed: int | None
) -> Measurements:
    """Measurements at commands q (rad), every 15 s; without noise if there is no seed."""
    plan, count = synthetic.even_schedule(*q.shape), len(q)
    tcp = synthetic.measure(described, truth, q, 0.0, 0.0 if seed is None else NOISE, seed or 0, plan)
    number = np.arange(1, count + 1)
    poses = Poses(q, np.zeros(count), directions(q, np.zeros(arm.dof)), plan.time_s)
    return Measurements(poses, number, tcp, None, NOISE, number, Path("simulated.csv"), "", arm=arm, arm_name=arm.name)


def _fitted(arm: Arm, data: Measurements, forms: Sequence[Effect], start: Model | None = None) -> Model:
    """The model with some forms, everything that the data can tell fitted."""
    plain = [effect for name in PLAIN for effect in effects_at(arm, name)]
    known = {} if start is None else {key: start.value(key) for key in start.keys}
    model = model_of(arm, (*plain, *forms), known)
    return fit_identifiable(model, data, model.keys).fit.model


def _error(model: Model, data: Measurements) -> ErrorStats:
    return error_stats(data.tcp - solve_equilibrium(model, data.poses).tcp)


def table(outcomes: Sequence[ExtrapolationOutcome]) -> str:
    """The table as Markdown, mm."""
    head = (
        "| arm | parameters, with forms | other half, RMS (mm) | with forms | ratio | anywhere, worst (mm) | "
        "with forms | nominal | with forms over nominal |"
    )
    lines = [head, "|" + "---|" * 9]
    for one in outcomes:
        mm = [1e3 * x for x in (one.beyond[0].rms, one.beyond[1].rms)]
        worst = [1e3 * x for x in (one.anywhere[0].max, one.anywhere[1].max, one.nominal.max)]
        lines.append(
            f"| {one.seed} | {one.parameters[0]}, {one.parameters[1]} | {mm[0]:.2f} | {mm[1]:.2f} | {one.worse:.2f} | "
            f"{worst[0]:.1f} | {worst[1]:.1f} | {worst[2]:.1f} | {one.farthest:.2f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Read the options, run, print the table."""
    options = asked(__doc__, arms=(ARMS, "how many arms"), poses=(POSES, "poses of each fit"))
    print(table([examine(seed, options.poses) for seed in range(options.arms)]))


if __name__ == "__main__":
    main()
