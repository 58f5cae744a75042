"""A shaper leaves its modes without swing and is positive; modes follow stiffness and inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.motion.modes import GYRATION, Modes, links_inertia, mean_inertia, modes_at
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.shaping import one_mode, shaper
from tests.support.motion_models import swinging

ARM = load_arm("lrm-rover")
WHOLE, MOST, TICK = 1 << 15, 64, 0.0065
kinds = st.sampled_from(["zv", "zvd", "zvdd"])
frequencies, dampings = st.floats(0.6, 10.0), st.floats(0.0, 0.4)


def modes(*pairs: tuple[float, float]) -> Modes:
    """Modes of these undamped frequencies (Hz) and damping ratios."""
    omega, damping = (np.array(column) for column in zip(*pairs, strict=True))
    return Modes(2.0 * np.pi * omega, damping, np.eye(len(pairs)), np.eye(len(pairs)))


def left(impulses, seconds: float, frequency: float, damping: float) -> float:
    """Swing that impulses (delay, share) leave, over that of one impulse (Singer & Seering 1990, eq. 4)."""
    t, share = (np.array(column, dtype=float) for column in zip(*impulses, strict=True))
    omega = 2.0 * np.pi * frequency
    own = -damping * omega + 1j * omega * np.sqrt(1.0 - damping**2)
    end = t.max() * seconds
    return float(abs(np.sum(share / share.sum() * np.exp(own * (end - t * seconds)))))


@given(kinds, frequencies, dampings)
def test_a_shaper_leaves_no_swing(kind, frequency, damping) -> None:
    damped = frequency * np.sqrt(1.0 - damping**2)
    assert left(one_mode(kind, damped, damping), 1.0, frequency, damping) < 1e-9


@given(frequencies, st.floats(0.0, 0.1))
def test_a_robust_kind_leaves_less_where_the_frequency_is_not_as_known(frequency, damping) -> None:
    damped = frequency * np.sqrt(1.0 - damping**2)
    off = [left(one_mode(kind, damped, damping), 1.0, 1.1 * frequency, damping) for kind in ("zv", "zvd", "zvdd")]
    assert off == sorted(off, reverse=True)
    assert off[0] < 0.25
    assert off[1] < 0.06


@given(kinds, st.lists(st.tuples(frequencies, st.floats(0.0, 0.1)), min_size=1, max_size=4))
def test_impulses_on_ticks_are_positive_few_and_whole_and_leave_little(kind, pairs) -> None:
    found = shaper(kind, modes(*pairs), TICK, WHOLE, MOST)
    assert sum(share for _, share in found) == WHOLE
    assert all(share > 0 and delay >= 0 for delay, share in found)
    assert found[0][0] == 0
    assert len(found) <= MOST
    slowest = sorted(pairs)[:3]
    assert max(left(found, TICK, *pair) for pair in slowest) < 0.1


def test_what_needs_no_shaper_gets_none() -> None:
    assert shaper("zv", modes((50.0, 0.05), (4.0, 0.7)), TICK, WHOLE, MOST) == ()


def test_inertia_is_positive_and_grows_with_the_load() -> None:
    """Its diagonal is the moment of inertia of point masses, and each body's own about its centre."""
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 6))
    M = links_inertia(ARM, q)
    np.testing.assert_allclose(M, M.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(M).min() > 0.0
    assert np.linalg.eigvalsh(links_inertia(ARM, q, 0.2) - M).min() > -1e-12
    chain, step = chain_of(ARM), 1e-6

    def centres(q):
        return chain_geometry(chain, chain.values(list(q.T)), len(q)).body.transpose(2, 0, 1)

    moved = [(centres(q + row) - centres(q - row)) / (2.0 * step) for row in step * np.eye(6)]
    mass = np.array([body.mass for body in chain.bodies])
    points = np.stack([np.sum(mass[:, None] * one**2, axis=(1, 2)) for one in moved], axis=1)
    beyond = [sum(body.mass for body in chain.bodies[chain.moved[slot] :]) for slot in chain.joint_slots]
    np.testing.assert_allclose(np.diagonal(M, axis1=1, axis2=2), points + GYRATION**2 * np.array(beyond), atol=1e-9)


def test_a_stretched_arm_swings_more_slowly_and_a_load_slows_it() -> None:
    model = swinging(joint2=(4.0, 0.05))
    rng = np.random.default_rng(2)
    mean = mean_inertia(ARM)[1, 1]
    for q in rng.uniform(-1.2, 1.2, (10, 6)):
        found = modes_at(model, q)
        ratio = links_inertia(ARM, q[None])[0, 1, 1] / mean
        assert found.omega[0] == pytest.approx(2.0 * np.pi * 4.0 / np.sqrt(ratio), rel=1e-9)
        assert found.damping[0] == pytest.approx(0.05 / np.sqrt(ratio), rel=1e-9)
        loaded = modes_at(model, q, 0.2)
        assert loaded.omega[0] < found.omega[0]


def test_coupled_joints_have_modes_below_and_above_those_of_each_alone() -> None:
    q = np.array([0.2, 0.6, 0.1, 0.8, 0.0, 0.0])
    alone = [modes_at(swinging(**{place: (5.0, 0.03)}), q).omega[0] for place in ("joint2", "joint4")]
    both = modes_at(swinging(joint2=(5.0, 0.03), joint4=(5.0, 0.03)), q).omega
    assert both.min() < min(alone) < max(alone) < both.max()


def test_an_arm_that_does_not_swing_has_no_modes() -> None:
    assert modes_at(replace(MotionModel.nominal(ARM)), np.zeros(6)) is None
