"""Data flows one way: lrmd -> lrm_math <- lrm_ident, and the generator knows nothing of the model it checks."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ON_THE_ROVER = {"numpy", "zenoh", "serial", "msgpack", "pydantic", "structlog"}
STDLIB = set(sys.stdlib_module_names)


def imported(path: Path) -> set[str]:
    """Top-level packages that a file imports, relative ones by the package's own name."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(path.relative_to(ROOT).parts[0] if node.level else (node.module or "").split(".")[0])
    return found


def files(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize(
    ("package", "allowed"),
    [("lrm_math", {"lrm_math", "numpy", "pydantic"}), ("lrmd", {"lrmd", "lrm_math"} | ON_THE_ROVER)],
)
def test_rover_packages_import_only_what_they_may(package: str, allowed: set[str]) -> None:
    for path in files(package):
        assert imported(path) - STDLIB <= allowed, path


def test_offline_tool_never_imports_the_daemon() -> None:
    assert files("lrm_ident")
    for path in files("lrm_ident"):
        assert "lrmd" not in imported(path), path


def test_generator_shares_no_code_with_the_model() -> None:
    generator = files("lrm_ident/synthetic")
    assert generator
    for path in generator:
        assert imported(path) - STDLIB <= {"lrm_ident", "numpy", "scipy"}, path
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert node.level in (0, 1), f"{path}: reaches out of its folder"
                assert node.level or not (node.module or "").startswith("lrm_"), path
