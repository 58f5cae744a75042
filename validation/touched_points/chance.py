"""`python -m validation.touched_points.chance`: how many of the twelve arms can be within 1.5 of the tracker's error?

By the Cramér–Rao bound: an efficient estimator that knows which effect is hidden, at the touches of `simulated_arms`,
their noise and the rounding of the commands. The parameters' errors are drawn from both bounds' covariances, one by
sockets and one by a tracker, and each draw has its own ratio of tip errors at the fresh poses. `--touches` and
`--placements` try another plan; `--tracker-poses` gives the tracker another number of poses than there are touches.
"""

from __future__ import annotations

import numpy as np

from lrm_ident.data.rigid_motion import skew
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef, effects_at
from lrm_math.effects.reference import BASE_OFFSETS
from lrm_math.model.derivatives import joint_jacobian, parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from validation.options import asked
from validation.touched_points.simulated_arms import (
    ARM,
    CASES,
    COUNT,
    FRESH,
    NOISE_M,
    NOTHING,
    PLACEMENTS,
    TOUCHES,
    deployed_poses,
    fresh_poses,
    planned,
)

WITHIN, PLACE_SD, COMPLIANCE = 1.5, 0.2, 0.045
"""Ratio that is asked for; m and rad by which it is known where a board stands; rad/(N m) of the springs."""
STATE = "last_pose"


def hidden_model(name: str, touches: int) -> Model:
    """The default effects, springs of those arms, and one effect of its typical size, half way through the touches."""
    effects = [effect for part in (*DEFAULT_EFFECTS, *([name] if name else [])) for effect in effects_at(ARM, part)]
    parts = [(e, key, part) for e in effects for key, part in zip(e.keys, e.parameters, strict=True)]
    free = [
        (e, key, part)
        for e, key, part in parts
        if part.fixed is None and ParameterRef.parse(key).effect != BASE_OFFSETS
    ]
    values = {key: part.typical for e, key, part in free if e.name == name}
    values |= {key: COMPLIANCE for _, key, _ in free if key.endswith("k_rad_per_Nm")}
    values |= {key: 0.5 * touches for _, key, _ in parts if key.endswith(STATE)}
    return model_of(ARM, effects, values).with_free(key for _, key, _ in free)


def tip_variances(model: Model, q: Array, placement: Array, fresh: Array) -> Array:
    """(W,), m², of the tip at fresh poses (F, n), rad, up to a rigid motion, along its principal directions, by touches
    (N, n), rad, at placements (N,) from 0, each with a frame of its own."""
    keys, known = model.free, typical_prior(model)
    sd = dict(zip(known.keys, np.sqrt(np.diag(known.covariance)), strict=True))
    settled, P, K = solve_equilibrium(model, deployed_poses(q)), len(keys), int(placement.max()) + 1
    A = np.zeros((len(q), 3, P + 6 * K))
    A[:, :, :P] = parameter_jacobian(settled, keys)
    for row, (frame, own) in enumerate(zip(placement, _rigid(settled.tcp), strict=True)):
        A[row, :, P + 6 * frame : P + 6 * frame + 6] = own
    J = joint_jacobian(settled)
    noise = NOISE_M**2 * np.eye(3) + COUNT**2 / 12.0 * J @ J.transpose(0, 2, 1)
    B = np.linalg.solve(np.linalg.cholesky(noise), A).reshape(-1, P + 6 * K)
    M = B.T @ B + np.diag([*(sd.get(key, np.inf) ** -2.0 for key in keys), *[PLACE_SD**-2.0] * (6 * K)])
    size = 1.0 / np.sqrt(np.diag(M))
    C = size[:, None] * np.linalg.inv(M * size * size[:, None]) * size
    seen = solve_equilibrium(model, deployed_poses(fresh))
    Q, _ = np.linalg.qr(_rigid(seen.tcp).reshape(-1, 6))
    F = parameter_jacobian(seen, keys).reshape(-1, P)
    F = F - Q @ (Q.T @ F)
    return np.linalg.eigvalsh(F @ C[:P, :P] @ F.T).clip(0.0)


def main() -> None:
    """Prints a row for each arm, and how many of them are within the ratio by chance."""
    options = asked(__doc__, draws=10000, touches=TOUCHES, placements=PLACEMENTS, tracker_poses=0)
    rng, fresh = np.random.default_rng(0), fresh_poses(np.random.default_rng(0))
    plan = planned(options.touches, options.placements)
    tracked = planned(options.tracker_poses, options.placements) if options.tracker_poses else plan
    where = np.array(plan.placement) - 1
    print("| hidden | sockets, bound (mm) | tracker, bound (mm) | ratio | within 1.5 by chance |")
    print("|---" * 5 + "|")
    near = np.zeros(options.draws, dtype=np.int_)
    for case in CASES:
        model = hidden_model(case.right[0] if case.right else NOTHING, options.touches)
        by = [
            tip_variances(model, plan.q, where, fresh),
            tip_variances(model, tracked.q, np.zeros(len(tracked.q), dtype=np.int_), fresh),
        ]
        bounds = [1e3 * float(np.sqrt(variances.sum() / FRESH)) for variances in by]
        drawn = [rng.normal(size=(options.draws, variances.size)) ** 2 @ variances for variances in by]
        within = drawn[0] <= WITHIN**2 * drawn[1]
        near += within
        cells = (f"{bounds[0]:.3f}", f"{bounds[1]:.3f}", f"{bounds[0] / bounds[1]:.2f}", f"{within.mean():.0%}")
        print(f"| {case.words} | {' | '.join(cells)} |", flush=True)
    shares = ", ".join(f"{count} or more {np.mean(near >= count):.1%}" for count in (len(CASES), 9))
    print(f"\nExpected within {WITHIN}: {near.mean():.1f} of {len(CASES)}; {shares}")


def _rigid(points: Array) -> Array:
    """(N, 3, 6), motion of points (N, 3), m, by a shift and by a turn about the origin."""
    return np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -skew(points)], axis=2)


if __name__ == "__main__":
    main()
