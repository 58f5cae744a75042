"""Values first, words last: no sentence for a user stands in a room of computation.

What is computed is a value; `lrm_ident.report.text` and the doors say it in words. An error says itself what is wrong
and what would be right, and a long computation what it does (`Progress`).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from itertools import chain

import pytest

from tests.conftest import ROOT
from tests.support.source_files import files, syntax_tree

pytestmark = pytest.mark.long

ROOMS = ("fitting", "residual", "diagnosis", "study", "design", "fleet")
FEWEST = 4
"""Words from which a text is taken for a sentence; values in it are not counted."""
WORD = re.compile(r"[A-Za-z][\w'-]+")
ERROR = re.compile(r"\w*(Error|Indistinguishable)")
SAID = re.compile(rf"{ERROR.pattern}|of_kind|add_note|progress|on_progress")
"""Calls that word an error, or name what a long computation does."""
ALLOWED = {
    "fitting/executors.py: version_faults": "faults of a cluster, which an error lists",
    "fitting/model_fit.py: _left": "what an error says of a fit without parameters",
    "fitting/transfer.py: NAME": "name of a prior in model files",
    "residual/covariates.py: SYMBOLS": "names of variables in JSON",
    "diagnosis/symbolic_regression/law_file.py": "writes the Python source of a law, with its docstring",
    "study/field_step.py: _words": "held-out errors in the refusal of a field",
    "study/inputs.py: read_measurements": "a notice of a file, words as all of `Measurements.notices`",
    "design/candidate_poses.py: violated_rules": "names of rules, in JSON and in the error that no pose keeps them",
    "design/pose_selection.py: select_poses": "names of the limits in JSON",
    "fleet/fleet_report.py": "the document of the command `fleet`",
}
"""Texts that stay, by file, or file and definition, each with the reason."""


def _text(node: ast.AST) -> str | None:
    """A literal, the values of an f-string left out."""
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)  # type: ignore[misc]
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else None


def _name(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _is_said(node: ast.AST) -> bool:
    """Whether a statement or call says its texts itself: an error, a progress label, a docstring, a `repr`."""
    match node:
        case ast.Raise() | ast.Expr(value=ast.Constant()) | ast.FunctionDef(name="__repr__"):
            return True
        case ast.ClassDef(bases=bases):
            return any(ERROR.fullmatch(_name(base)) for base in bases)
        case ast.Call(func=func, args=args):
            named = [_name(func), *(map(_name, args[:1]) if _name(func) == "partial" else ())]
            return any(SAID.fullmatch(name) for name in named)
    return False


def _assigned(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Names that a statement assigns, each with its value."""
    if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        pairs = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=False))
        yield from ((_name(one), value) for one, value in pairs if _name(one))


def _within(node: ast.AST) -> set[ast.AST]:
    return set(ast.walk(node))


def sentences(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Texts of a module that read like a sentence and that nothing in it says, with the definition they stand in.

    What a name holds is said where all its uses are.
    """
    every = list(ast.walk(tree))
    said = set(chain.from_iterable(_within(node) for node in every if _is_said(node)))
    said |= {
        part for node in every if isinstance(node, ast.JoinedStr) for part in node.values if _text(part) is not None
    }
    scopes = [tree, *(node for node in every if isinstance(node, ast.FunctionDef))]
    grown = -1
    while grown != len(said):
        grown = len(said)
        for scope in scopes:
            inside = _within(scope)
            loads = [node for node in inside if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)]
            for name, value in chain.from_iterable(map(_assigned, inside)):
                uses = [node for node in loads if node.id == name and node not in _within(value)]
                if uses and all(node in said for node in uses):
                    said |= _within(value)
    for top in tree.body:
        own = next((name for name, _ in _assigned(top)), getattr(top, "name", ""))
        for node in ast.walk(top):
            text = None if node in said else _text(node)
            if text is not None and " " in text and len(WORD.findall(text)) >= FEWEST:
                yield own, text


@pytest.mark.parametrize("room", ROOMS)
def test_no_sentence_for_a_user_stands_in_a_room_of_computation(room: str) -> None:
    new, allowed = [], set()
    for path in files(f"lrm_ident/{room}"):
        file = path.relative_to(ROOT / "lrm_ident").as_posix()
        for own, text in sentences(syntax_tree(path)):
            entry = {file, f"{file}: {own}"} & ALLOWED.keys()
            allowed |= entry
            new += [] if entry else [f"{file}: {own}: {text!r}"]
    assert not new, "\n".join(["a value here, its words in lrm_ident/report/text:", *new])
    assert allowed == {one for one in ALLOWED if one.startswith(f"{room}/")}, "these are gone: shorten the list"


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("def f(a):\n    return f'the tip is {a} mm too far away'", 1),
        ("LABELS = {'a': 'every joint came from one side'}", 1),
        ("def f():\n    '''What it gives, in a few words.'''\n    raise LrmError('no pose is far enough away')", 0),
        ("def f(a):\n    right = 'give one number for each joint'\n    raise LrmError(f'{a}: {right}')", 0),
        ("def f(a):\n    right = 'give one number for each joint'\n    return a or right", 1),
        ("def f(study):\n    return partial(study.progress, 'trying every effect at every place')", 0),
        ("def f():\n    return 'offsets.joint1.d_mm'", 0),
    ],
)
def test_a_sentence_is_told_from_a_name_and_from_what_an_error_says(source: str, count: int) -> None:
    assert len(list(sentences(ast.parse(source)))) == count
