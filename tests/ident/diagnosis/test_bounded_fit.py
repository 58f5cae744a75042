"""The linear estimate within bounds, and the refits of what the screening underrates without them."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis import confirm as confirmation
from lrm_ident.diagnosis.candidate_trial import CandidateTrial
from lrm_ident.diagnosis.confirm import confirm
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.replication import replicates
from lrm_ident.diagnosis.screening.bounded_fit import BoundedFit
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

POSES, RIDGE = 6, 0.01
LAB = load_arm("lrm-lab")
TRUE, FALSE = "lateral_compliance@link1", "lateral_compliance@link2"


def least_squares_of_active_sets(columns: Array, right: Array, lower: Array) -> Array:
    """(p,), the least squares above some lower bounds, by trying every set of parameters at their bounds."""
    best = (np.inf, lower)
    for held in map(np.array, product((False, True), repeat=len(lower))):
        x = np.where(held, lower, 0.0)
        if not held.all():
            x[~held] = np.linalg.lstsq(columns[:, ~held], right - columns[:, held] @ lower[held], rcond=None)[0]
        if (x >= lower - 1e-12).all():
            best = min(best, (float(((right - columns @ x) ** 2).sum()), x), key=lambda one: one[0])
    return best[1]


@given(st.integers(0, 2**31), st.integers(4, POSES))
@settings(max_examples=60, deadline=None)
def test_it_is_the_least_of_all_sets_of_parameters_at_their_bounds(seed: int, known: int) -> None:
    """Of the poses that it is estimated from; the others are predicted."""
    rng = np.random.default_rng(seed)
    free = np.linalg.qr(rng.normal(size=(3 * POSES, 2)))[0]
    moved, bounded, residual = rng.normal(size=(3 * POSES, 1)), rng.normal(size=(3 * POSES, 3)), rng.normal(size=18)
    lower = np.array([0.0, -0.1, -0.3])
    linear = SimpleNamespace(measured=3 * POSES, rows=3, ridge=RIDGE)
    screening: Any = SimpleNamespace(linear=linear, weigh=lambda columns: columns)
    parameter = SimpleNamespace(lower=0.0, upper=np.inf, typical=1.0)
    acting = SimpleNamespace(rows=(0,), parameters=(parameter,))
    one: Any = SimpleNamespace(at_shape=(acting, moved), shape=(0.0,))
    upper, held = np.full(3, np.inf), np.array([True, False, False])
    whole = BoundedFit(screening, np.arange(18), free, bounded, residual, lower, upper, held)
    poses = rng.permutation(POSES)[:known]
    found = whole.from_poses(poses).explain(one) if known < POSES else whole.explain(one)

    trained = (3 * poses[:, None] + np.arange(3)).reshape(-1)
    columns, right = np.column_stack([bounded, moved]), residual

    def without_free(rows: Array) -> Array:
        return np.asarray(rows - free @ np.linalg.lstsq(free[trained], rows[trained], rcond=None)[0])

    columns, right = without_free(columns), without_free(right)
    penalised = np.vstack([columns[trained], [0.0, 0.0, 0.0, np.sqrt(RIDGE)]])
    x = least_squares_of_active_sets(penalised, np.append(right[trained], 0.0), np.append(lower, 0.0))
    np.testing.assert_allclose(found.squares, ((right - columns @ x).reshape(-1, 3) ** 2).sum(axis=1), atol=1e-9)
    at_bound = x <= np.append(lower, 0.0) + 1e-9
    assert found.as_screened is bool((at_bound == [True, False, False, False]).all())


@pytest.fixture(scope="module")
def bent() -> Diagnosis:
    """Link 1 bends by 0.08 rad/Nm about both axes; three angles a joint, 0.3 mm of noise per axis."""
    rng = np.random.default_rng(4)
    poses = poses_of(rng.choice(np.radians([-40.0, 0.0, 40.0]), size=(150, LAB.dof)))
    [effect], nominal = effects_at(LAB, TRUE), nominal_model(LAB)
    values = {key: nominal.value(key) for key in nominal.keys}
    values |= {f"compliance.joint{joint}.k_rad_per_Nm": 0.03 for joint in (2, 3, 4)}
    values |= dict(zip(effect.keys, (0.08, 0.08, 0.1875), strict=True))
    tcp = solve_equilibrium(model_of(LAB, (*nominal.effects, effect), values), poses).tcp
    data = Measurements.of_tcp(poses, tcp + rng.normal(0.0, 3e-4, tcp.shape), 3e-4, pose=np.arange(1, 151))
    return diagnose(fit_identifiable(nominal, data, nominal.keys).fit.model, data)


@pytest.mark.slow
def test_without_a_bound_in_the_way_it_is_the_estimate_of_the_screening(bent: Diagnosis) -> None:
    screening = bent.screening
    linear, some, same = screening.linear, screening.scored[::5], 0
    for one, found in zip(some, BoundedFit.of(screening).explain_each(some), strict=True):
        if found.as_screened:
            same += 1
            left = linear.residual[: linear.measured] - one.added
            np.testing.assert_allclose(found.squares.sum(), (left**2).sum(), rtol=1e-6)
    assert same > 5


@pytest.mark.slow
def test_of_two_links_the_bent_one_replicates(bent: Diagnosis) -> None:
    """Without bounds it was the other: it predicted either half better, with negative compliances of the first one."""
    scored = {one.name: one for one in bent.scored}
    assert replicates(bent.screening, scored[TRUE], ())
    assert not replicates(bent.screening, scored[FALSE], ())


@pytest.mark.slow
def test_a_bent_link_is_not_named_by_its_neighbour(bent: Diagnosis) -> None:
    """Link 2 was an identified cause. Its estimate needs negative compliances, and compliance of joint 2, which the fit
    has put to zero, comes back beside a bend of link 1."""
    first = bent.supported[0]
    assert (first.name, bent.equivalent[FALSE]) == (FALSE, ()), "the screening alone is still misled"
    found = confirm(bent)
    assert (found.first.name, found.diagnosis.equivalent[TRUE]) == (TRUE, ())
    assert found.refits[FALSE].error.rms > 1.3 * found.refit.error.rms
    assert found.rivals[FALSE] == found.refits[FALSE].error.rms, "on the scale of a refit"
    assert [*found.rivals.values()] == sorted(found.rivals.values())


def led(
    patch: pytest.MonkeyPatch,
    first: float | None,
    rival: float | None,
    refused: tuple[str, ...] = (),
    alike: tuple[str, ...] = ("near",),
    spurious: tuple[str, ...] = (),
) -> tuple[Any, dict[str, Any]]:
    """The diagnosis after the trial of a first effect and of one that is underrated, and the refits of others.

    Each leaves a mean square; None: there is an objection. The first has a class of two. `refused`: effects that are no
    candidates any more. `alike`: those that move the TCP as the rival does. `spurious`: those that free functions make
    needless.
    """
    ripple = 0.05 * np.sin(np.arange(60))

    def trial(left: float | None) -> CandidateTrial:
        fitted: Any = None if left is None else SimpleNamespace(squares=left + ripple * left, fit=None)
        return CandidateTrial(fitted)

    one, other, near = (SimpleNamespace(name=name) for name in ("first", "rival", "near"))
    bounded = SimpleNamespace(underrated=lambda *_: [other])
    patch.setattr(confirmation, "BoundedFit", SimpleNamespace(of=lambda _: bounded))
    patch.setattr(confirmation, "moves_alike", lambda _, member: member.name in alike)
    diagnosis: Any = SimpleNamespace(
        supported=(one,),
        screening=None,
        unexplained=SimpleNamespace(spurious=dict.fromkeys(spurious)),
        scored=(one, near, SimpleNamespace(name="far"), other),
        equivalent={"first": ("far", "near")},
        led_by=lambda leader, members: (leader.name, members),
    )
    found, _, refits = confirmation._led_by_underrated(
        diagnosis, trial(first), lambda *_: trial(rival), np.ones(60), refused
    )
    return found, refits


@pytest.mark.parametrize(
    ("first", "rival", "leader", "members"),
    [
        (0.5, 0.8, "first", ("far", "near")),  # refitted, it explains less
        (0.5, 0.3, "rival", ("near",)),  # it is better, and told from the class of the first one
        (0.5, 0.5, "first", ("far", "near", "rival")),  # prediction cannot separate them
        (None, 0.3, "rival", ("near",)),
    ],
)
def test_of_refits_the_least_error_leads(
    first: float | None, rival: float, leader: str, members: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a first effect that moves the TCP as it does stays in its class, however much worse its refit is; not one
    to whose trial there is an objection."""
    found, refits = led(monkeypatch, first, rival)
    assert found == (leader, members)
    assert set(refits) == ({"first", "rival"} if first else {"rival"}) - {leader}
    (leads, members_then), _ = led(monkeypatch, first, rival, alike=("first", "near"))
    assert leads == leader
    assert ("first" in members_then) is (leader == "rival" and first is not None)


def test_what_was_refused_is_not_refitted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """`auto` refuses an effect with which the model cannot be diagnosed: it would be added for ever."""
    assert led(monkeypatch, 0.5, 0.3, ("rival",)) == (("first", ("far", "near")), {})


def test_what_free_functions_make_needless_is_not_refitted(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would lead, but is not supported: the step had the name of the next effect and the refit of this one."""
    assert led(monkeypatch, 0.5, 0.3, spurious=("rival",)) == (("first", ("far", "near")), {})


def test_where_all_are_refused_the_trial_of_the_first_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    diagnosis, refits = led(monkeypatch, None, None)
    assert diagnosis.supported[0].name == "first"
    assert not refits
