"""The help, the version, what a command loads, `lrm-ident explain` and the page of the glossary."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from argparse import _SubParsersAction
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from lrm_ident.cli.app import COMMANDS, OF_THE_DAEMON, SECTIONS, app, run
from lrm_ident.cli.examples import EXAMPLES
from lrm_ident.report.glossary import SOURCE, TERMS, term_named
from lrm_math.effects import CATALOGUE
from lrmd.cli.app import parser as lrm_parser
from tests.conftest import ROOT
from tests.support.commands import stderr_of, stdout_of


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


def test_commands_of_lrm_are_told_to_be_of_lrm() -> None:
    answer = CliRunner().invoke(app, ["deploy", "best.toml"])
    assert answer.exit_code == 2
    assert "deploy is a command of the daemon's program: lrm deploy" in answer.stderr
    (commands,) = (action.choices for action in lrm_parser()._actions if isinstance(action, _SubParsersAction))
    assert {*commands} - {*COMMANDS} == OF_THE_DAEMON


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


def test_a_command_of_a_group_has_no_examples_of_another_command() -> None:
    for words in (["motion", "fit"], ["motion", "design"], ["arm", "show"], ["arm", "import"]):
        assert "Examples:" not in CliRunner().invoke(app, [*words, "--help"]).stdout


def test_the_page_is_the_codes() -> None:
    """`make schemas` copies it; every entry of it is read."""
    page = SOURCE.read_text(encoding="utf-8")
    assert (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8") == page
    assert len(TERMS) == page.count("\n: ") > 25


def test_every_word_leads_to_one_term() -> None:
    words = [re.sub(r"[\W_]+", "", word).lower() for term in TERMS for word in (term.name, *term.others)]
    assert len(words) == len(set(words))
    assert [term.name for term in TERMS] == sorted((term.name for term in TERMS), key=str.lower)


@pytest.mark.parametrize("word", ["held-out error", "Held out", "held_out_error", "cross-validation"])
def test_a_word_is_found_however_it_is_written(word: str) -> None:
    assert term_named(word).name == "held-out error"


def test_a_term_is_explained_in_two_sentences_at_most() -> None:
    for term in TERMS:
        assert term.meaning.endswith("."), term.name
        assert all(len(sentence.split()) <= 30 for sentence in re.split(r"(?<=[.:]) ", term.meaning)), term.name


def test_a_term_an_effect_and_all_of_them_are_printed() -> None:
    assert stdout_of("explain", "RMS").startswith("RMS: Root mean square")
    assert "source:" in stdout_of("explain", "backlash@joint2")
    assert stdout_of("explain", "--all").count("\n") >= len(TERMS)
    listed = " ".join(stdout_of("explain").split())
    assert all(term.name in listed for term in TERMS)


@pytest.mark.parametrize("name", [kind.id for kind in CATALOGUE])
def test_every_effect_is_explained_with_a_place(name: str) -> None:
    """`quantisation` needs the table of every servo, which the SO-101 has not: it ended in a traceback."""
    assert re.search(r"^    places, for example on [\w-]+: \w", stdout_of("explain", name), re.MULTILINE)


def test_an_effect_of_ones_own_may_have_no_place_on_a_shipped_arm(tmp_path: Path) -> None:
    own = tmp_path / "far.py"
    own.write_text(
        "from lrm_math.effects import Description, LinearEffect, Parameter\n"
        "class Far(LinearEffect):\n"
        "    id, about, targets = 'far', Description('c', 'f', 's'), ('joint9.theta',)\n"
        "    parameters = (Parameter('a_rad', 'sine', 0.02),)\n"
        "    @classmethod\n"
        "    def places(cls, arm): return ('joint9',) if arm.dof > 8 else ()\n"
        "    def basis(self, poses, tau): return ((poses.angle(8),),)\n",
        encoding="utf-8",
    )
    assert "places: none on so101 or lrm-rover" in stdout_of("effects", "far", "--effects-file", str(own))


def test_an_unknown_word_is_one_line_that_says_where_the_words_are() -> None:
    assert "did you mean 'residual'?" in stderr_of("explain", "residul")
    assert "lrm-ident explain lists the terms" in stderr_of("explain", "qqqqqq")
