"""Registration of commands: what all of them check, and the options by which measurements are read."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from pydantic import ValidationError
from typer import Option, Typer
from typer.models import ArgumentInfo, OptionInfo

from lrm_ident.cli.app import app
from lrm_ident.cli.arguments import CompanionFiles
from lrm_ident.cli.examples import examples_of
from lrm_ident.cli.help_sections import SectionedCommand
from lrm_ident.data.atomic_write import check_outputs, is_something_else
from lrm_ident.report.plots.style import check_format
from lrm_math.errors import FileError, LrmError
from lrm_math.model.reading import Reading

OUTPUTS = {"output": "-o", "json": "--json", "figure": "--figure", "cross_figure": "--cross-figure"}
"""Parameters of commands that name files to be written; `arguments.CompanionFiles` says what is written beside them."""
FIGURES = ("figure", "cross_figure")
TABLE, TOML, PAGE = (".csv", ".tsv", ".txt", ".dat"), (".toml",), (".html", ".htm")
ENDINGS: Mapping[str, tuple[str, ...]] = {
    "CSV": TABLE, "DATA": TABLE, "MOVES": TABLE, "MODEL": TOML, "MODEL2": TOML, "ARM": TOML, "LENS": TOML,
    "REPORT.html": PAGE, "HTML": PAGE, "PDF": (".pdf",), "LAW.py": (".py",), "JSON": (".json",),
}  # fmt: skip
"""Endings of the files that an output may name, the usual one first, by the word that stands for it in the help."""
KNOWN_ENDINGS = {*chain.from_iterable(ENDINGS.values()), ".xlsx", ".ods", ".png", ".svg", ".urdf", ".xml", ".yaml"}
READING_OPTIONS: Mapping[str, Any] = {
    name: Annotated[str | None, Option(f"--{name.replace('_', '-')}", help=words)]
    for name, words in {
        "unit": "Unit of the positions: mm, m, cm, um or inch. Default: as the names of the columns state.",
        "angle_unit": "Unit of the joint angles: deg or rad. Default: as the names of the columns state.",
        "axes": "Which axes of the file are the arm's x, y, z, for instance x,y,-z or y,x,z.",
        "frame": "Frame of the positions. unknown: the fit finds it. arm: that of the arm file.",
        "joint_sign": "Direction of each joint, 1 or -1, for instance 1,1,-1,1,1,1.",
        "joint_order": "For each joint of the arm, its number in the file: 1,3,2,4,5,6.",
        "bad_rows": "What to do with rows that have a cell without a number: refuse (default) or skip.",
    }.items()
}
"""Options that a parameter `reading` of a command stands for."""


def command_group(name: str, summary: str) -> Typer:
    """A group of commands of the application, as yet without any."""
    group = Typer(no_args_is_help=True, rich_markup_mode=None, help=summary)
    app.add_typer(group, name=name)
    return group


def command_of(group: Typer, name: str | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Registers commands of a group: outputs are checked before the work, a parameter `reading` becomes its options."""

    def register(function: Callable[..., None]) -> Callable[..., None]:
        """Adds the function to the group under its own name."""
        command_name = name or function.__name__.rstrip("_").replace("_", "-")  # `import_` is the command `import`
        in_short = " ".join((inspect.getdoc(function) or "").partition("\n\n")[0].split())
        examples = examples_of(command_name) if group is app else None  # `fit` and `motion fit` are different commands
        shown = with_options(_checked(function), "reading", READING_OPTIONS, stated_reading)
        group.command(command_name, cls=SectionedCommand, short_help=in_short, epilog=examples)(shown)
        return function

    return register


def with_options(
    function: Callable[..., None],
    parameter: str,
    annotations: Mapping[str, Any],
    value_of: Callable[[dict[str, Any]], object],
) -> Callable[..., None]:
    """A command with arguments and options in place of one of its parameters, which `value_of` makes of their values.

    Arguments stand where the parameter stood, options behind all others; an option that is not given is None. A command
    without the parameter stays as it is.
    """
    signature, hints = inspect.signature(function), get_type_hints(function, include_extras=True)
    if parameter not in signature.parameters:
        return function
    arguments, options = list[inspect.Parameter](), list[inspect.Parameter]()
    for name, annotation in annotations.items():
        if isinstance(annotation.__metadata__[0], ArgumentInfo):
            arguments.append(inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=annotation))
        else:
            options.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation))
    annotated = {name: [each.replace(annotation=hints[name])] for name, each in signature.parameters.items()}
    shown = [*chain.from_iterable((annotated | {parameter: arguments}).values()), *options]

    @functools.wraps(function)
    def run(**values: Any) -> None:
        stated = {name: values.pop(name) for name in annotations}
        function(**{parameter: value_of(stated)}, **values)

    run.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in shown}
    return run


def _checked(function: Callable[..., None]) -> Callable[..., None]:
    """The command, its files checked before it is called."""
    beside = {
        name: mark
        for name, hint in get_type_hints(function, include_extras=True).items()
        for mark in getattr(hint, "__metadata__", ())
        if isinstance(mark, CompanionFiles)
    }

    kinds = {name: _kind(function, name) for name in ("output", "json")}

    @functools.wraps(function)
    def run(**values: Any) -> None:
        appended = {option for name, option in OUTPUTS.items() if name in beside and beside[name].appended}
        check_outputs(_outputs(values, beside), _inputs(values), appended)
        for name, kind in kinds.items():
            if values.get(name) is not None:
                _check_ending(values[name], OUTPUTS[name], kind)
        for figure in (values[name] for name in FIGURES if values.get(name) is not None):
            check_format(figure)
        function(**values)

    return run


def _kind(function: Callable[..., None], name: str) -> str:
    """The word of the help that stands for an output; "" without one."""
    hint = get_type_hints(function, include_extras=True).get(name)
    words = [mark.metavar for mark in getattr(hint, "__metadata__", ()) if isinstance(mark, OptionInfo)]
    return "JSON" if name == "json" else (words[0] or "") if words else ""


def _check_ending(path: Path, option: str, kind: str) -> None:
    """Raises `FileError`: the name of an output ends as that of a file of another kind, as which programs read it."""
    ending, expected_ending = path.suffix.lower(), ENDINGS.get(kind)
    if expected_ending is not None and ending in KNOWN_ENDINGS and ending not in expected_ending:
        raise FileError(path, "", f"{option} writes no {ending} file", f"name it {expected_ending[0]}")


def _outputs(values: dict[str, Any], beside: Mapping[str, CompanionFiles]) -> dict[str, Path]:
    """Files that the command writes, by the option that names them, those beside them too."""
    named = {name: values[name] for name in OUTPUTS if values.get(name) is not None}
    out = {OUTPUTS[name]: path for name, path in named.items()}
    for name, mark in beside.items():
        if name in named:
            out |= {f"the {what} of {OUTPUTS[name]}": named[name].with_suffix(end) for end, what in mark.files.items()}
    return out


def _inputs(values: dict[str, Any]) -> list[Path]:
    """Files that the command reads: its other paths, arms and priors given by path, and what is beside the data."""
    named = [value for name, value in values.items() if name not in OUTPUTS]
    paths = [value for value in named if isinstance(value, Path)]
    paths += [Path(value) for value in named if isinstance(value, str) and value.endswith(".toml")]
    beside = [path.with_suffix(".toml") for path in paths if path.name and path.suffix != ".toml"]
    return [*paths, *(path for path in beside if path.exists() and not is_something_else(path))]


def stated_reading(options: dict[str, str | None]) -> Reading:
    """The reading that the options state. Raises `LrmError`."""
    said: dict[str, Any] = {name: text for name, text in options.items() if text is not None}
    for name in ("joint_sign", "joint_order"):
        if name in said:
            said[name] = _whole_numbers(name, said[name])
    try:
        return Reading(**said)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        name = str(fault["loc"][0])
        message = fault["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
        raise LrmError(f"--{name.replace('_', '-')} {options[name]}: should be {message}") from None


def _whole_numbers(name: str, text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise LrmError(f"--{name.replace('_', '-')} {text}: should be whole numbers by commas") from None


command = command_of(app)
"""Registers a command of the application."""
