"""`lrm.compare` on poses that a fit did not see: the model's own error is the held-out one, and nothing is refitted."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.study.study import Study

pytestmark = pytest.mark.long

SPRINGS = "compliance.joint*.k_rad_per_Nm"
Train = Callable[[Measurements], Fit | Study]


def fit(data: Measurements) -> Fit:
    return lrm.fit(data, parameters=SPRINGS)


def study(data: Measurements) -> Study:
    return lrm.Study.of(data).fit(SPRINGS)


@pytest.fixture
def halves(tmp_path: Path) -> tuple[Measurements, Measurements]:
    """The example in two files, every other pose in each."""
    header, *rows = lrm.EXAMPLE.read_text(encoding="utf-8").splitlines()
    files = tmp_path / "even.csv", tmp_path / "odd.csv"
    for k, file in enumerate(files):
        file.write_text("\n".join([header, *rows[k::2], ""]), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        even, odd = (lrm.load(file, "lrm-lab") for file in files)
    return even, odd


@pytest.mark.parametrize("train", [fit, study])
def test_a_part_of_the_file_that_was_left_out_is_compared_as_it_is(train: Train) -> None:
    data = lrm.load(lrm.EXAMPLE)
    fitted, rest = train(data.take(np.arange(100))), data.take(np.arange(100, 200))
    seen = lrm.compare(fitted, rest)
    missed = np.linalg.norm(lrm.predict(fitted, rest.poses) - rest.tcp, axis=1)
    assert seen.held_out.error is None
    assert seen.error.mean == pytest.approx(float(missed.mean()))
    assert lrm.compare(fitted, data.take(np.arange(50, 150))).held_out.error is not None, "half of them were fitted"


@pytest.mark.parametrize("train", [fit, lambda data: fit(data).model, study])
def test_another_file_is_compared_as_the_command_compares_it(
    train: Train, halves: tuple[Measurements, Measurements], tmp_path: Path
) -> None:
    even, odd = halves
    study(even).save(tmp_path / "model.toml")
    by_file = lrm.read_study(tmp_path / "model.toml", odd.source.path).compare()
    seen = lrm.compare(train(even), odd)
    assert seen.held_out.error is by_file.held_out.error is None
    assert seen.held_out.reason == by_file.held_out.reason
    assert seen.error.rms == pytest.approx(by_file.error.rms)


def test_poses_kept_aside_are_remembered_by_the_file(tmp_path: Path) -> None:
    data, aside = lrm.load(lrm.EXAMPLE), range(201, 301)
    kept = study(data.without(aside))
    kept.save(tmp_path / "model.toml")
    by_file = lrm.read_study(tmp_path / "model.toml", lrm.EXAMPLE, part=Measurements.only).compare()
    seen = lrm.compare(kept, data.only(aside))
    assert seen.data.pose.tolist() == by_file.data.pose.tolist() == list(aside)
    assert seen.held_out.error is by_file.held_out.error is None
    assert seen.error.rms == pytest.approx(by_file.error.rms)


def test_what_is_fitted_to_these_poses_next_has_seen_them() -> None:
    data = lrm.load(lrm.EXAMPLE)
    rest = data.take(np.arange(100, 200))
    again = lrm.add(fit(data.take(np.arange(100))), rest, "compliance@base")
    assert lrm.compare(again, rest).held_out.error is not None
