"""An arm with an error without a name, fitted, and with a residual field: once for all tests that look at it."""

from __future__ import annotations

import pytest

from lrm_ident.study.study import Study
from tests.support.nameless_arm import measured


@pytest.fixture(scope="session")
def fitted() -> Study:
    """The fit of the thesis's first option."""
    return Study.of(measured(1, 3e-3)).fit("option1")


@pytest.fixture(scope="session")
def with_field(fitted: Study) -> Study:
    """The same with a field."""
    return fitted.add("residual_field")
