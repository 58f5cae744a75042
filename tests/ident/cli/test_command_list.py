"""The help, the version and what a command loads."""

from __future__ import annotations

import shlex
import subprocess
import sys

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from lrm_ident.cli.app import COMMANDS, SECTIONS, app, run
from lrm_ident.cli.examples import EXAMPLES


def loaded_by(code: str) -> set[str]:
    """Modules that are loaded after some code in a process of its own."""
    words = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    return set(subprocess.run(words, capture_output=True, text=True, check=True).stdout.split())


def test_the_help_lists_every_command_by_what_it_is_for() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    assert list(SECTIONS) == ["Try", "Measure", "Identify", "Look", "Design", "Drive"]
    places = [shown.index(f"\n{title}:") for title in SECTIONS]
    assert places == sorted(places)
    for command in COMMANDS.values():
        assert f"  {command.name} " in shown
        assert command.summary in shown
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("name", COMMANDS)
def test_every_listed_command_is_there(name: str) -> None:
    assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0


def test_every_registered_command_is_listed() -> None:
    group = get_command(app)
    for name in COMMANDS:
        assert group.get_command(None, name) is not None  # type: ignore[attr-defined]
    registered = {command.name for command in app.registered_commands if command.callback}
    registered |= {str(each.name) for each in app.registered_groups}
    assert {name.replace("_", "-") for name in registered} | {"import"} == set(COMMANDS)


def test_a_misspelt_command_is_asked_back() -> None:
    found = CliRunner().invoke(app, ["diagnos"])
    assert found.exit_code == 2
    assert "Did you mean 'diagnose'" in found.stderr


def test_a_shell_completes_commands_and_their_options() -> None:
    for words, expected in (("lrm-ident ch", "checkup"), ("lrm-ident arm export --m", "--mjcf")):
        asked = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" ")), "_LRM_IDENT_COMPLETE": "complete_bash"}
        shown = CliRunner().invoke(app, env=asked, prog_name="lrm-ident").stdout
        assert expected in shown.split()


def test_the_version_is_that_of_the_package() -> None:
    assert CliRunner().invoke(app, ["--version"]).stdout.startswith("lrm-ident ")


def test_the_help_loads_no_command_and_no_numbers() -> None:
    code = "from typer.testing import CliRunner\nfrom lrm_ident.cli.app import app\nCliRunner().invoke(app, ['--help'])"
    loaded = loaded_by(code)
    assert "lrm_ident.cli.app" in loaded
    assert not {"numpy", "scipy", "pydantic", "matplotlib", "lrm_ident.cli.command"} & loaded


@pytest.mark.long
def test_a_fit_loads_neither_scipy_nor_what_diagnoses() -> None:
    loaded = loaded_by("import lrm_ident.cli.fit")
    assert "lrm_ident.study.study" in loaded
    assert not {"scipy", "matplotlib", "lrm_ident.diagnosis.diagnose"} & loaded


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("Singular matrix"), ZeroDivisionError("division by zero")])
def test_no_command_ends_in_a_traceback_of_arithmetic(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    def fails() -> None:
        raise error

    with pytest.raises(SystemExit) as end:
        run(fails)  # type: ignore[arg-type]
    assert end.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_fault_of_the_code_keeps_its_traceback() -> None:
    def fails() -> None:
        raise AttributeError("a fault")

    with pytest.raises(AttributeError):
        run(fails)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_in_the_help_use_options_that_exist(name: str) -> None:
    command = get_command(app).get_command(None, name)  # type: ignore[attr-defined]
    options = {option for parameter in getattr(command, "params", ()) for option in parameter.opts}
    for example in EXAMPLES.get(name, ()):
        words = shlex.split(example)
        assert words[:2] == ["lrm-ident", name]
        assert {word for word in words if word.startswith("-")} <= options
