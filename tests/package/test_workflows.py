"""The workflows of GitHub, and the files beside them: each command is a target of make, each path is there."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.conftest import ROOT

GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
MADE = ("dist", "out")
"""Folders that a workflow makes."""
BESIDE_MAKE = ("gh release create ",)
INDEXES = ("pypi.org", "pythonhosted", "registry.npmjs", "anaconda.org", "deb.debian.org", "mcr.microsoft", "ghcr.io")


def jobs() -> Iterator[tuple[str, dict[str, Any]]]:
    """Every job of every workflow, with its name."""
    for path in WORKFLOWS:
        for name, job in yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"].items():
            yield f"{path.name}: {name}", job


def steps() -> Iterator[tuple[str, dict[str, Any]]]:
    """Every step of every job, with the job's name."""
    for name, job in jobs():
        yield from ((name, step) for step in job.get("steps", ()))


def commands(job: dict[str, Any]) -> Iterator[str]:
    """Lines that the job's steps run, once for each case of its matrix."""
    matrix = {f"${{{{ matrix.{name} }}}}": of for name, of in job.get("strategy", {}).get("matrix", {}).items()}
    lines = [line for step in job.get("steps", ()) for line in step.get("run", "").splitlines()]
    for line, case in product(lines, product(*matrix.values())):
        for name, value in zip(matrix, case, strict=True):
            line = line.replace(name, value)
        yield line


def test_every_workflow_that_the_project_needs_is_there() -> None:
    assert [path.stem for path in WORKFLOWS] == ["lint", "release", "site", "tests", "weekly", "wheels"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_may_only_read_unless_a_job_says_more(path: Path) -> None:
    assert yaml.safe_load(path.read_text(encoding="utf-8"))["permissions"] == {"contents": "read"}


def test_every_command_is_a_target_of_make() -> None:
    wrong = []
    for name, job in jobs():
        for line in commands(job):
            make = re.match(r"make ([a-z-]+)(?= |$)", line)
            if not (make and make[1] in TARGETS) and not line.startswith(BESIDE_MAKE):
                wrong.append(f"{name}: {line}")
    assert not wrong, "\n".join(wrong)


def test_every_path_is_there_or_is_made() -> None:
    for name, step in steps():
        given = step.get("with", {})
        named = [given[key] for key in ("path", "output-dir", "cache-dependency-path") if key in given]
        for one in named:
            first = one.split("/")[0]
            assert first in MADE or (ROOT / one).exists(), f"{name}: {one}"


def test_paths_that_start_a_workflow_are_there() -> None:
    for path in WORKFLOWS:
        on = yaml.safe_load(path.read_text(encoding="utf-8"))[True]  # `on` is true in YAML 1.1
        for event in on.values():
            for one in (event or {}).get("paths", ()) if isinstance(event, dict) else ():
                assert (ROOT / one).exists(), f"{path.name}: {one}"


def test_every_action_has_a_version_and_every_own_workflow_is_there() -> None:
    used = [step["uses"] for _, step in steps() if "uses" in step] + [job["uses"] for _, job in jobs() if "uses" in job]
    for one in used:
        if one.startswith("./"):
            assert (ROOT / one).exists(), one
        else:
            assert re.search(r"@(v\d+|release/v\d+)", one), one


def test_every_job_ends_by_itself() -> None:
    for name, job in jobs():
        assert "timeout-minutes" in job or "uses" in job or name.endswith((": deploy", ": publish")), name


def test_the_pythons_tested_are_those_that_the_package_names() -> None:
    classified = re.findall(r"Python :: (3\.\d+)\"", (ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    tests = yaml.safe_load((GITHUB / "workflows" / "tests.yml").read_text(encoding="utf-8"))
    assert tests["jobs"]["linux"]["strategy"]["matrix"]["python"] == classified


def test_owners_and_forms_name_what_is_there() -> None:
    for line in (GITHUB / "CODEOWNERS").read_text(encoding="utf-8").splitlines():
        path = line.split()[0] if line and not line.startswith("#") else "*"
        assert path == "*" or (ROOT / path.strip("/")).exists(), line
    for form in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml"):
        assert yaml.safe_load(form.read_text(encoding="utf-8")), form


def test_no_file_names_an_index_of_packages() -> None:
    """Which index a client asks is for the machine that it runs on to say."""
    places = [
        *GITHUB.rglob("*.yml"), *(ROOT / "packaging").rglob("*"), *(ROOT / ".devcontainer").iterdir(),
        ROOT / "Makefile", ROOT / "pyproject.toml",
    ]  # fmt: skip
    for path in (path for path in places if path.is_file() and path.suffix != ".pyc"):
        text = path.read_text(encoding="utf-8")
        assert not [one for one in INDEXES if one in text], path


def test_make_prints_what_each_target_of_a_workflow_would_do() -> None:
    named = {line.split()[1] for _, job in jobs() for line in commands(job) if line.startswith("make ")}
    done = subprocess.run(["make", "-n", *sorted(named)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_development_container_is_described() -> None:
    described = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text(encoding="utf-8"))
    assert "make setup" in described["postCreateCommand"]
