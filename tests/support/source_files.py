"""The project's own Python files and their syntax trees, for tests of its structure."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from tests.conftest import ROOT


def folder_of(package: str) -> Path:
    """Where a package of the project is: at its root, or in `integrations/NAME/src`; another folder as it is named."""
    integration = ROOT / "integrations" / package / "src" / package
    return integration if integration.is_dir() else ROOT / package


def files(folder: str) -> list[Path]:
    """The Python files below a package or a folder of the project; there is at least one."""
    found = sorted(folder_of(folder).rglob("*.py"))
    assert found, folder
    return found


@cache
def syntax_tree(path: Path) -> ast.Module:
    """The parsed file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported_names(path: Path) -> tuple[str, ...]:
    """Dotted names that a file imports anywhere, in functions and under TYPE_CHECKING too; relative ones resolved."""
    return tuple(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(syntax_tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = path.relative_to(ROOT).parts[: -node.level] if node.level else ()
            yield from (".".join([*package, *filter(None, [node.module]), alias.name]) for alias in node.names)


def late_look_ups(path: Path, package: str) -> set[str]:
    """Modules of a package that a file names as text, to import them by `import_module`."""
    constants = (node.value for node in ast.walk(syntax_tree(path)) if isinstance(node, ast.Constant))
    named = (text for text in constants if isinstance(text, str) and re.fullmatch(rf"{package}(\.[a-z_]\w*)+", text))
    return {name for name in named if (module := folder_of(package).joinpath(*name.split(".")[1:])).is_dir()
            or module.with_suffix(".py").is_file()}  # fmt: skip


def room_arrows(package: str) -> set[tuple[str, str]]:
    """Pairs of folders at the top of a package of which the first imports from the second, itself or in a subfolder."""
    arrows = set()
    for path in files(package):
        room, *below = path.relative_to(ROOT / package).parts
        for name in imported_names(path) if below else ():
            head, _, rest = name.partition(".")
            other = rest.partition(".")[0]
            if head == package and (ROOT / package / other).is_dir() and other != room:
                arrows.add((room, other))
    return arrows
