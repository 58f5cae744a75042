"""The application `lrm-ident`: commands loaded when called for, and one clear line for every expected error."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from traceback import extract_tb
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup
from typer.main import get_command_from_info, get_group
from typer.models import CommandInfo

from lrm_ident.cli.encodings import print_plainly
from lrm_ident.data.last_error import note_error
from lrm_math.command_line import INTERRUPTED
from lrm_math.errors import LrmError
from lrm_math.stdout import os_error_words

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`, of its header malloc.h."""


@dataclass(frozen=True)
class ListedCommand:
    """A command or group of commands: its module below `lrm_ident.cli`, and its line in the help."""

    name: str
    module: str
    summary: str


SECTIONS = {
    "Try": (
        ListedCommand("demo", "example", "Run the whole story on the shipped example."),
        ListedCommand("example", "example", "Write the shipped example as a file of your own."),
    ),
    "Measure": (
        ListedCommand("arm", "groups.arm", "Import, describe, show or export an arm."),
        ListedCommand("measure", "campaign", "Move an arm through poses and measure its tip."),
        ListedCommand("camera", "groups.camera", "Measure with a webcam and a printed board."),
        ListedCommand("sockets", "groups.sockets", "Hold the tip in printed sockets; no tracker needed."),
        ListedCommand("import", "groups.recordings", "Convert a recording to measurements."),
        ListedCommand("dataset", "groups.dataset", "Check a data set that others will use."),
        ListedCommand("align", "component_tests", "Measure the offset from tracker targets to the tip."),
        ListedCommand("stiffness", "component_tests", "Measure the stiffness of one servo under load."),
    ),
    "Identify": (
        ListedCommand("fit", "fit", "Fit the model of an arm to measurements."),
        ListedCommand("diagnose", "diagnosis", "Find the physical effect that a model is missing."),
        ListedCommand("add", "diagnosis", "Add an effect to a model and refit everything."),
        ListedCommand("undo", "fit", "Undo the last step of a model."),
        ListedCommand("auto", "diagnosis", "Add missing effects one by one, until none is found."),
        ListedCommand("transfer", "groups.transfer", "Move a calibrated model to another base and tool."),
        ListedCommand("propose", "diagnosis", "Search for a formula where no known effect fits."),
        ListedCommand("checkup", "groups.recordings", "Check a LeRobot recording for faults of the arm."),
        ListedCommand("motion", "groups.motion", "Find what makes an arm lag, stick or swing."),
        ListedCommand("fleet", "groups.fleet", "Identify many arms of one kind and compare them."),
    ),
    "Look": (
        ListedCommand("compare", "fit", "Show where a model fails on measurements."),
        ListedCommand("report", "report", "Write all results as one HTML page."),
        ListedCommand("workbench", "workbench", "Open everything in the browser (extra: page)."),
        ListedCommand("show", "report", "Show a model: its steps, errors and parameters."),
        ListedCommand("predict", "fit", "Predict tip position and joint torques at poses."),
        ListedCommand("effects", "fit", "Explain the effects of the catalogue."),
        ListedCommand("explain", "groups.explain", "Explain a word that the commands use."),
        ListedCommand("report-bug", "groups.bug_report", "Write what a bug report needs, without your data."),
    ),
    "Design": (
        ListedCommand("design", "design", "Choose the poses to measure next."),
        ListedCommand("choose-poses", "design", "Choose the best poses among measured ones."),
        ListedCommand("identify-parameters", "design", "List the parameters that a set of poses determines."),
        ListedCommand("selftest", "diagnosis", "Predict which effects a set of poses can detect."),
        ListedCommand("reach", "workspace", "Map the workspace of an arm and compare variants."),
    ),
    "Drive": (
        ListedCommand("verify", "campaign", "Send the tip to goals and measure where it lands."),
    ),
}  # fmt: skip
COMMANDS = {command.name: command for section in SECTIONS.values() for command in section}
WIDEST = max(map(len, COMMANDS))
OF_THE_DAEMON = frozenset((
    "deploy", "disarm", "estop", "fk", "goto", "gripper", "hold", "ik", "info", "level1", "logs", "move", "pan-tilt",
    "plan", "record", "relax", "reload", "reset", "skill", "state",
))  # fmt: skip
"""Commands of `lrm`, which drives the arm, without those of the same name here."""


class LazyGroup(TyperGroup):
    """The listed commands, each imported at its first use: the help needs none of them."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = dict.fromkeys(COMMANDS)  # type: ignore[assignment]  # names; built by `get_command`

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name, from its module; None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        if self.commands[cmd_name] is None:
            import_module(f"lrm_ident.cli.{COMMANDS[cmd_name].module}")
            registered: list[Any] = [*app.registered_groups, *app.registered_commands]
            entry = next(entry for entry in registered if entry.name == cmd_name)
            self.commands[cmd_name] = (
                get_command_from_info(entry, pretty_exceptions_short=True, rich_markup_mode=None)
                if isinstance(entry, CommandInfo)
                else get_group(entry.typer_instance)
            )
        return self.commands[cmd_name]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that a command line begins with, and its arguments; one of `lrm` is told as such."""
        if args and args[0] in OF_THE_DAEMON:
            ctx.fail(f"{args[0]} is a command of the daemon's program: lrm {args[0]}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Lists the commands by what they are for."""
        for title, section in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(f"{command.name:<{WIDEST}}", command.summary) for command in section])


class WrappedHelp(TyperGroup.context_class.formatter_class):  # type: ignore[name-defined,misc]
    """Help of every command, wrapped at spaces only: a name such as lrm-rover stays in one piece."""

    def write_text(self, text: str) -> None:
        """A paragraph."""
        super().write_text(text.replace("-", _HYPHEN))

    def write_dl(self, rows: Sequence[tuple[str, str]], *sizes: int) -> None:
        """A list of names and what they are."""
        super().write_dl([(name, words.replace("-", _HYPHEN)) for name, words in rows], *sizes)

    def getvalue(self) -> str:
        """All that was written."""
        return str(super().getvalue()).replace(_HYPHEN, "-")


_HYPHEN = "\u2011"
"""A hyphen where no line ends."""
TyperGroup.context_class.formatter_class = WrappedHelp
app = typer.Typer(
    cls=LazyGroup,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"max_content_width": 110},
    help="Identify the model of a robot arm from measured TCP positions, see where it fails, find what is missing.\n\n"
    "Start with:\n\n\b\n  lrm-ident demo\n  lrm-ident fit DATA.csv --arm lrm-lab -o model.toml\n"
    "  lrm-ident diagnose model.toml DATA.csv",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from lrm_ident.study.tool_version import tool_version

        print(tool_version())
        raise typer.Exit


@app.callback()
def group(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the application itself; without them it would be a single command."""


def main() -> None:
    """Runs the command of `lrm-ident`."""
    _keep_freed_memory()
    print_plainly()
    run(app)


def _keep_freed_memory() -> None:
    """Lets glibc keep the memory of large arrays for the next ones: the kernel would clear it anew each time."""
    with suppress(AttributeError, OSError, TypeError):  # another C library
        allocator = ctypes.CDLL(None)
        allocator.mallopt(M_MMAP_THRESHOLD, 32 << 20)
        allocator.mallopt(M_TRIM_THRESHOLD, 128 << 20)


def run(application: typer.Typer) -> None:
    """Runs the command; every expected error is one line on stderr and exit code 2."""
    try:
        application()
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _fail("interrupted", INTERRUPTED)
        raise
    except LrmError as error:
        note_error(error)
        _fail(str(error))
    except OSError as error:
        note_error(error)
        _fail(os_error_words(error))
    except Exception as error:
        note_error(error)
        if not is_numerical(error):
            raise
        _fail(f"a computation failed: {_where(error)}; please report the command and its files")


def _show_usage_error(error: Any) -> None:
    """Prints a command that is called wrongly as every other expected error: which, what is wrong, how it is called."""
    from lrm_ident.cli.consoles import print_error

    words = error.format_message().rstrip(".").replace("Input should be", "should be")
    words = words[:1].lower() + words[1:]
    if error.ctx is None:
        print_error(f"{words}; --help behind the command explains its options")
    else:
        command, usage = error.ctx.command_path, " ".join(error.ctx.command.collect_usage_pieces(error.ctx))
        print_error(f"{command}: {words}; usage: {command} {usage}, see {command} --help")


typer.BadParameter.__base__.show = _show_usage_error  # type: ignore[union-attr]  # the class of all usage errors


def _fail(words: str, code: int = 2) -> NoReturn:
    from lrm_ident.cli.consoles import print_error

    print_error(words)
    sys.exit(code)


def _where(error: Exception) -> str:
    frames = [frame for frame in extract_tb(error.__traceback__) if "lrm_" in frame.filename]
    at = f" in {frames[-1].name}" if frames else ""
    return f"{type(error).__name__}{at}{f' ({error})' if str(error) else ''}"


def is_numerical(error: Exception) -> bool:
    """Whether an exception comes from arithmetic rather than from the code: no traceback helps who meets it."""
    from numpy.linalg import LinAlgError

    return isinstance(error, LinAlgError | ArithmeticError | MemoryError)
