"""Imports go one way: lrmd -> lrm_math <- lrm_ident, between the folders of each from the top of a list to its bottom.

What measures with the arm drives it as any rover software does, through `lrmd.client`.

The generator of synthetic data knows nothing of the model that it checks.
"""

from __future__ import annotations

import ast
import re
import sys
from itertools import chain

import pytest

from tests.conftest import ROOT
from tests.support.source_files import files, folder_of, imported_names, late_look_ups, room_arrows, syntax_tree

pytestmark = pytest.mark.long

ON_THE_ROVER = {"numpy", "zenoh", "serial", "msgpack", "pydantic", "structlog"}
STDLIB = set(sys.stdlib_module_names)
LAYERS = {
    "lrm_math": "errors stdout command_line arrays text_file number_list atomic_file plausibility toml_file "
    "arm kinematics collision effects motion model ik",
    "lrm_ident": "data fitting residual diagnosis study design report fleet measuring workbench cli",
    "lrmd": "errors heap background log config persistence link messages ramp safety control sim ik api client cli "
    "main demo",
    "lrm_ros2": "diagnostics action_types message_types trajectory sender_watch arrivals ros_endpoints ros_node "
    "bridge action command",
    "lrm_skills": "behaviours rafcon_library",
    "lerobot_robot_lrm": "units least_deviation kernel_arm wish_times lead servo_motion correction bounded "
    "corrected_arm servo_check wrapped_robot calibrated_robot calibrated_pair processor pipelines registration",
}
"""Folders and modules of each package; each imports only from those before it, so there is no cycle between them."""
IMPORT = re.compile(r"^ *(?:from ([\w.]+) import|import ([\w.]+))", re.MULTILINE)
"""The module of each line that imports, also in code that is written as text."""
LATE = {
    "lrm_ident/data/notebook/__init__.py": {"lrm_ident.workbench.notebook"},
    "lrm_ident/diagnosis/diagnosis_report.py": {"lrm_ident.report.text.reasons"},
    "lrm_ident/study/notices.py": {"lrm_ident.report.text.notices"},
    "lrm_ident/study/study.py": {"lrm_ident.report.summary"},
}
"""Modules above a file that it looks up by name, once a person asks for a picture, a summary or a reason."""


@pytest.mark.parametrize("package", LAYERS)
def test_folders_import_only_from_layers_below(package: str) -> None:
    layers = LAYERS[package].split()
    upward = []
    for path in files(package):
        own = path.relative_to(folder_of(package)).with_suffix("").parts[0]
        if own.startswith("__"):  # the package's own front may reach everything
            continue
        assert own in layers, f"{own} has no place in the layers of {package}"
        late = late_look_ups(path, package) - LATE.get(path.relative_to(ROOT).as_posix(), set())
        for name in (*imported_names(path), *late):
            imported = name.split(".")[:2]
            if imported[0] == package and imported[-1] not in layers[: layers.index(own) + 1]:
                upward.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not upward, "\n".join(upward)


def test_late_look_ups_upward_are_those_that_are_listed() -> None:
    for file, names in LATE.items():
        assert names <= late_look_ups(ROOT / file, file.split("/")[0]), f"{file} looks up others: shorten the list"


@pytest.mark.parametrize(
    ("package", "allowed"),
    [("lrm_math", {"lrm_math", "numpy", "pydantic"}), ("lrmd", {"lrmd", "lrm_math"} | ON_THE_ROVER)],
)
def test_rover_packages_import_only_what_they_may(package: str, allowed: set[str]) -> None:
    for path in files(package):
        assert {name.split(".")[0] for name in imported_names(path)} - STDLIB <= allowed, path


def test_rooms_of_the_offline_tool_are_few_and_loosely_coupled() -> None:
    """At most 14 entries at its top, and 60 arrows from room to room."""
    top = {path.name for path in (ROOT / "lrm_ident").iterdir() if path.name != "__pycache__"}
    assert len(top) <= 14, sorted(top)
    arrows = room_arrows("lrm_ident")
    print(f"{len(arrows)} arrows between rooms of lrm_ident")
    assert len(arrows) <= 60, sorted(arrows)


def test_offline_tool_meets_the_daemon_through_its_client_only() -> None:
    """Only measuring imports it, its commands, and the page's panel of a rover."""
    for path in files("lrm_ident"):
        imported = {name for name in imported_names(path) if name.split(".")[0] == "lrmd"}
        own = path.relative_to(ROOT / "lrm_ident").as_posix()
        measures = own.startswith("measuring/campaign/") or own in ("cli/arm_access.py", "workbench/tab/rover_link.py")
        assert not imported or (measures and all(name.startswith("lrmd.client.") for name in imported)), path


def test_imports_of_the_projects_own_modules_name_some_that_are_there() -> None:
    """Types are not checked in all of validation and the tests: there an import could name a file that moved."""
    for path in (path for package in (*LAYERS, "validation", "examples", "bench", "tests") for path in files(package)):
        for name in filter(None, chain.from_iterable(IMPORT.findall(path.read_text(encoding="utf-8")))):
            if name.split(".")[0] in LAYERS:
                package, *rest = name.split(".")
                module = folder_of(package).joinpath(*rest)
                assert module.is_dir() or module.with_suffix(".py").is_file(), f"{path.relative_to(ROOT)}: {name}"


def test_what_ships_needs_nothing_that_does_not() -> None:
    for path in (path for package in LAYERS for path in files(package)):
        shipped = {name.split(".")[0] for name in imported_names(path)}
        assert not shipped & {"validation", "examples", "bench", "tests"}, path


def test_generator_shares_no_code_with_the_model() -> None:
    for path in files("validation/synthetic"):
        assert {name.split(".")[0] for name in imported_names(path)} - STDLIB <= {"validation", "numpy", "scipy"}, path
        for node in ast.walk(syntax_tree(path)):
            if isinstance(node, ast.ImportFrom):
                assert node.level in (0, 1), f"{path}: reaches out of its folder"
                assert node.level or not (node.module or "").startswith(("lrm_", "validation")), path
