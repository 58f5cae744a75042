"""A recursion by blocks is the recursion step by step; links that swing follow the midpoint rule step by step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.motion.linear_recursion import linear_recursion
from lrm_math.motion.links import LinksAlongPath


@given(st.integers(1, 40), st.integers(1, 4), st.booleans(), st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_blocks_give_what_single_steps_give(count: int, n: int, steady: bool, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(scale=0.6, size=(1 if steady else count, n, n, 3, 1 if steady else 2))
    b, x = rng.normal(size=(count, n, 3, 2)), rng.normal(size=(n, 3, 2))
    expected = [x]
    for k in range(count):
        expected.append(np.einsum("ij...,j...->i...", A[0 if steady else k], expected[-1]) + b[k])
    assert linear_recursion(A, b, x) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("alike", [True, False], ids=["springs alike", "springs of each row"])
def test_swinging_links_follow_the_midpoint_rule(alike: bool) -> None:
    """M (v₁ − v₀ + J) = −h (D v̄ + K z̄), with the mean of both ends of a step and J the servos' jump of speed."""
    rng, h, soft, substeps = np.random.default_rng(3), 0.008, [0, 2], 2
    S, T, P, n = 2, 20, 3, 6
    path = np.cumsum(rng.normal(scale=0.03, size=(S, T, n)), axis=1)
    links = LinksAlongPath.of(load_arm("lrm-rover"), path, substeps)
    M = (T - 1) * substeps
    servos = np.cumsum(rng.normal(scale=0.01, size=(M + 1, P, S, n)), axis=0)
    rows = np.ones((P, 1)) if alike else np.array([[1.0], [1.2], [1.0]])
    omega, ratio = rows * [22.0, 30.0], rows * [0.05, 0.08]
    z = links.deflections(servos, soft, omega, ratio, h)
    speed = np.diff(servos, axis=0, prepend=servos[:1]) / h
    v = np.zeros((P, S, 2))
    assert np.ptp(z) > 1e-3
    for k in range(M):
        inertia = links.inertia[k // substeps]
        own, all_ = inertia[:, soft][..., soft], inertia[:, soft]
        thrown = np.linalg.solve(own, all_)
        v = v - np.einsum("skn,psn->psk", thrown, speed[k + 1] - speed[k])
        after = 2.0 * (z[k + 1] - z[k]) / h - v
        K = (omega**2 * links.mean[soft])[:, None]
        D = (2.0 * ratio * omega * links.mean[soft])[:, None]
        gained = np.einsum("skl,psl->psk", own, after - v)
        pulled = -h * (0.5 * D * (v + after) + 0.5 * K * (z[k] + z[k + 1]))
        assert gained == pytest.approx(pulled, abs=1e-11)
        v = after
