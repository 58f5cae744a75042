"""When nothing is said to be missing: only where the error does not surely exceed a known noise, by however little."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_ident.residual.residual_structure import ResidualStructure
from lrm_ident.residual.thresholds import NOT_NOISE
from tests.support.upright_arm import upright_measurements

NOISE = 3e-4


def verdict(ratio: float, p_value: float, structure: float, noise: float | None) -> Verdict:
    """Verdict on a residual of so many times the noise, without an effect or a function that is supported."""
    found: Any = SimpleNamespace(
        supported=(), unexplained=SimpleNamespace(functions=()), floor=SimpleNamespace(sd=noise),
        fit=SimpleNamespace(sigma=ratio), structure=ResidualStructure(0.0, structure, 1.0),
        screening=SimpleNamespace(lack_of_fit_p_value=p_value),
    )  # fmt: skip
    found.above_floor = Diagnosis.above_floor.fget(found)  # type: ignore[attr-defined]
    return Verdict(Diagnosis.verdict.fget(found))  # type: ignore[attr-defined]


shares = st.floats(0.0, 1.0)


@given(st.floats(0.5, 3.0), shares, shares)
def test_nothing_is_missing_only_within_the_noise(ratio: float, p_value: float, structure: float) -> None:
    """Before: up to 1.15 times the noise, however sure the excess was."""
    found = verdict(ratio, p_value, structure, 1.0)
    assert (found == Verdict.NOTHING_MISSING) <= (p_value >= NOT_NOISE)
    assert (found == Verdict.UNPREDICTABLE) <= (p_value < NOT_NOISE)


@given(st.floats(0.5, 3.0), st.tuples(shares, shares), shares)
def test_a_surer_excess_is_never_quieter(ratio: float, p_values: tuple[float, float], structure: float) -> None:
    surer, other = (verdict(ratio, p_value, structure, 1.0) for p_value in sorted(p_values))
    assert surer.quiet <= other.quiet


@given(st.floats(0.5, 3.0), shares)
def test_without_a_known_noise_nothing_exceeds_it(ratio: float, structure: float) -> None:
    found = verdict(ratio, float("nan"), structure, None)
    assert found == Verdict.NOISE_UNKNOWN
    assert found.quiet


def test_an_excess_of_an_eighth_is_seen_in_many_poses(tmp_path: Path) -> None:
    model, data = upright_measurements(tmp_path, 1, 300, NOISE)
    base = fit_model(model, data, "identifiable", SQUARED).fit.model
    assert diagnose(base, data).verdict == Verdict.NOTHING_MISSING
    assert (
        diagnose(base, data.with_positions(replace(data.positions, noise_sd=NOISE / 1.125))).verdict
        == Verdict.UNPREDICTABLE
    )
