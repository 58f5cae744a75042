"""Commands that are called wrongly: one line with the program's name, and exit code 2; no option is guessed."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import pytest

from tests.conftest import ROOT

CALLS = {
    "lrmd": ("from lrmd.main import main", ["--simulatd"], "unrecognized arguments: --simulatd; see lrmd --help"),
    "lrmd, nothing to run": ("from lrmd.main import main", [], "state the configuration with --config FILE"),
    "lrmd, a choice": ("from lrmd.main import main", ["--undo", "x"], "unknown 'x'; valid: model, motion"),
    "lrm": ("from lrmd.cli.app import main", ["mve"], "unknown 'mve'; did you mean move?"),
    "lrm, part of --go": ("from lrmd.cli.app import main", ["plan", "--q", "0", "--g"], "unrecognized arguments: --g;"),
    "lrm, part of --accept": ("from lrmd.cli.app import main", ["deploy", "--acc"], "unrecognized arguments: --acc;"),
    "lrmd.demo": ("from lrmd.demo import main", ["--speed", "x"], "--speed: invalid float value: 'x'"),
    "lrm-ros2": ("from lrm_ros2.command import main", ["--domain", "x"], "--domain: invalid int value: 'x'"),
    "lrmd-board": ("from lrmd.sim.process import main", ["here"], "unrecognized arguments: here"),
    "examples.fetch": ("from examples.fetch.__main__ import main", ["--stones", "x"], "invalid int value: 'x'"),
    "examples.demo": ("from examples.demo.__main__ import main", ["--seed", "x"], "invalid int value: 'x'"),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_call_is_one_line(name: str) -> None:
    imported, words, expected = CALLS[name]
    code = f"import sys; {imported}; sys.exit(main({words!r}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert expected in done.stderr
    assert done.stderr.startswith((f"{name.partition(',')[0]}: ", "error: "))


@pytest.mark.parametrize(
    ("place", "called"),
    [
        ("lrmd.cli.status.state", "from lrmd.cli.app import main; sys.exit(main(['state']))"),
        ("lrmd.config.load_config", "from lrmd.main import main; sys.exit(main(['--simulated']))"),
        ("lrmd.demo.run", "from lrmd.demo import main; sys.exit(main([]))"),
        (
            "lrm_ident.report.glossary.term_named",
            "sys.argv = ['lrm-ident', 'explain', 'RMS']; from lrm_ident.__main__ import main; main()",
        ),
    ],
)
def test_ctrl_c_is_one_line_and_exit_code_130(place: str, called: str) -> None:
    """Before: a traceback, or nothing; and `lrm` ended with 1, as a motion that did not reach its goal."""
    module = place.rpartition(".")[0]
    patch = f"mock.patch('{place}', side_effect=KeyboardInterrupt).start()"
    stop = f"import sys, {module}; from unittest import mock; {patch}"
    done = subprocess.run([sys.executable, "-c", f"{stop}; {called}"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.strip().endswith(": interrupted"), done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("loads", "called"),
    [
        ("lrmd.cli.motion", "from lrmd.cli.__main__ import main; sys.exit(main(['state']))"),
        ("lrmd.config", "from lrmd.main import main; sys.exit(main(['--simulated']))"),
        ("lrm_ident.cli.app", "from lrm_ident.__main__ import main; main()"),
    ],
)
def test_ctrl_c_while_a_command_loads_is_one_line(loads: str, called: str) -> None:
    """Before: `lrm` printed a traceback of its imports."""
    stop = f"""import sys
class CtrlC:
    def find_spec(name, *_):
        if name == '{loads}':
            raise KeyboardInterrupt
sys.meta_path.insert(0, CtrlC)"""
    done = subprocess.run([sys.executable, "-c", f"{stop}\n{called}"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, ""), done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stderr.strip().endswith(": interrupted")


def test_the_installed_lrm_is_the_one_that_ctrl_c_may_end_while_it_loads() -> None:
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["lrm"]
    assert stated == "lrmd.cli.__main__:main"
    for other in ("packaging/conda/recipe.yaml", "packaging/deb.sh"):
        assert "lrmd.cli.app" not in (ROOT / other).read_text()
