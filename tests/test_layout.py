"""A class name means one thing in the project, a folder can be looked over, a docstring begins with its subject."""

from __future__ import annotations

import ast
from collections import Counter, defaultdict

from tests.conftest import ROOT
from tests.support.source_files import files, syntax_tree

OTHERS = ("examples", "bench", "validation", "firmware", "tests/support", "tests/soak")
PACKAGES = ("lrm_math", "lrmd", "lrm_ident", "lrm_ros2", *OTHERS)
MOST_FILES = 14
NO_SUBJECT = {"As", "For", "Of", "What", "Where", "With"}
"""First words of a docstring that names neither what a thing is nor what it does."""


def test_public_class_names_are_unique() -> None:
    where: defaultdict[str, list[str]] = defaultdict(list)
    for path in (path for package in PACKAGES for path in files(package)):
        for node in syntax_tree(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                where[node.name].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    shared = [f"{name}: {', '.join(places)}" for name, places in sorted(where.items()) if len(places) > 1]
    assert not shared, "\n".join(shared)


def test_no_folder_has_too_many_files() -> None:
    sources = [path for package in PACKAGES for path in files(package) if path.name != "__init__.py"]
    sizes = Counter(path.parent.relative_to(ROOT).as_posix() for path in sources)
    assert {folder: size for folder, size in sizes.items() if size > MOST_FILES} == {}


def test_a_docstring_begins_with_a_noun_or_a_verb() -> None:
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    wrong = []
    for path in (path for package in (*PACKAGES, "tests") for path in files(package)):
        for node in (node for node in ast.walk(syntax_tree(path)) if isinstance(node, kinds)):
            words = (ast.get_docstring(node) or "-").split()
            if words[0] in NO_SUBJECT:
                wrong.append(f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}: {' '.join(words[:6])}")
    assert not wrong, "\n".join(wrong)
