"""Fixtures of several tests: arms, the folder of real measurements."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting import cross_validation
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from tests.support.sweep import USUAL_EXAMPLES, in_soak

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
TABLE_B2 = ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml"
EXAMPLE = ROOT / "lrm_ident" / "data" / "examples" / "hidden-play.csv"

os.environ.pop("COLUMNS", None)  # workers of pytest have one; what commands print in a pipe does not depend on it
os.unsetenv("COLUMNS")  # readline, which pytest imports, sets it where os.environ does not see it
os.environ.setdefault("XDG_STATE_HOME", str(ROOT / "out" / "state"))  # not where the person's own errors are kept
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # started in the background: commands are sent it here
_LAWS = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
settings.register_profile("lrm", _LAWS, max_examples=USUAL_EXAMPLES)
settings.register_profile("thorough", _LAWS, max_examples=300, derandomize=False)  # make soak
settings.load_profile("lrm")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leaves out what is for `make soak` alone."""
    left_out = set() if in_soak() else {item for item in items if item.get_closest_marker("soak")}
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=[*left_out])
    _slow_files_first(items)


def _slow_files_first(items: list[pytest.Item]) -> None:
    """Files with slow tests first in each third of the list, with which three workers begin: no long test comes last.

    A file stays together, since its tests share fixtures.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow") or item.get_closest_marker("long")}
    files = sorted(dict.fromkeys(item.path for item in items), key=lambda path: path not in slow)
    place = {path: number for third in range(3) for number, path in enumerate(files[third::3], third * len(files))}
    items.sort(key=lambda item: place[item.path])


@pytest.fixture(scope="module")
def one_step_folds() -> Iterator[None]:
    """Held-out errors are one step from the fit, as of many poses: a refit of every fold is half of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cross_validation, "MOST_REFITTED", 0)
        yield


@pytest.fixture(scope="session")
def lab() -> Arm:
    """The rig of the real measurements."""
    return load_arm("lrm-lab")


@pytest.fixture(scope="session")
def rover() -> Arm:
    """The arm on the rover."""
    return load_arm("lrm-rover")


@pytest.fixture(scope="session")
def so101() -> Arm:
    """The small arm of LeRobot."""
    return load_arm("so101")


@pytest.fixture(scope="session")
def lawful(lab: Arm) -> Arm:
    """The lab arm with every body standing in the frame of the joint that it loads, so that gravity has an energy."""
    return replace(
        lab,
        bodies=tuple(b if b.frame > lab.dof else replace(b, frame=b.loads_joint, near_end=False) for b in lab.bodies),
    )


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real data; absent at a user's place."""
    if not SHARED.exists():
        pytest.skip("the folder ../shared with the real measurements is not here")
    return SHARED


@pytest.fixture(scope="session")
def real(shared: Path, lab: Arm) -> Measurements:
    """The 393 measured poses without load."""
    return load_measurements(shared / "data" / "lrm-lab-no-load" / "measurements.csv", lab)
