"""What several tests share: the shipped example fitted and diagnosed, and a cluster of Dask."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import lrm_ident as lrm
from tests.conftest import EXAMPLE


@pytest.fixture(scope="session")
def example_study() -> lrm.Study:
    """The shipped example, fitted."""
    return lrm.Study.of(lrm.load(EXAMPLE)).fit()


@pytest.fixture(scope="session")
def example_diagnosis(example_study: lrm.Study) -> lrm.DiagnosisReport:
    """Its diagnosis."""
    return example_study.diagnose()


@pytest.fixture(scope="session")
def better_study(example_study: lrm.Study) -> lrm.Study:
    """The same with the effect that it hides."""
    return example_study.add("backlash@joint2")


@pytest.fixture(scope="session")
def example_model(example_study: lrm.Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its model file, which `lrm-ident fit` would write the same. No test writes to it."""
    path = tmp_path_factory.mktemp("example") / "model.toml"
    example_study.save(path)
    return path


@pytest.fixture(scope="module")
def two_workers() -> Iterator[str]:
    """Address of a Dask cluster of two worker processes."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address
