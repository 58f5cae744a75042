"""An output is whole or absent; it is never an input, nor a file that the tool did not write, a device or a folder."""

from __future__ import annotations

import ast
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.cli.app import app
from lrm_ident.cli.command import OUTPUTS
from lrm_ident.data.atomic_write import is_own, write_bytes, write_text
from lrm_math.errors import FileError
from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import run_command, stderr_of, stdout_of
from tests.support.source_files import files, syntax_tree

FOREIGN = b"pose,q1_deg\n1,2\n"
WRITES = {"write_text", "write_bytes", "savefig", "imwrite"}
OWN_FOLDERS = {"atomic_write.py", "capture.py", "identify_arm.py", "proposal.py", "session_files.py"}
"""The writer, and what writes into folders that it made itself a moment before."""


def commands(group: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command of the application by its words."""
    for name in group.commands:
        found = group.get_command(None, name)
        if hasattr(found, "commands"):
            yield from commands(found, (*words, name))
        else:
            yield (*words, name), found


def writing() -> Iterator[tuple[tuple[str, ...], Any, str, str]]:
    """Every command that writes, the option, and the ending of the file that would be in its way."""
    for words, command in commands(typer.main.get_command(app)):
        for parameter in command.params:
            if parameter.name in OUTPUTS:
                option = OUTPUTS[parameter.name]
                yield words, command, option, ".png" if "figure" in option else ".html"
                if "its numbers beside it" in (getattr(parameter, "help", "") or ""):
                    yield words, command, option, ".csv"


CASES = list(writing())


def required(command: Any, given: str, folder: Path) -> list[str]:
    """Words that fill a command's arguments and required options with anything that is there."""
    (folder / "in.csv").write_bytes(EXAMPLE.read_bytes())
    words = []
    for parameter in command.params:
        if not parameter.required or given in parameter.opts:
            continue
        text = str(folder / ("new.html" if parameter.name in OUTPUTS else "in.csv"))
        words += [text] if parameter.param_type_name == "argument" else [parameter.opts[0], text]
    return words


def test_the_commands_that_write_are_found() -> None:
    assert len({words for words, *_ in CASES}) >= 20
    assert (("arm", "show"), "--figure", ".csv") in [(words, option, end) for words, _, option, end in CASES]


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "command", "option", "end"), CASES, ids=[f"{' '.join(w)} {o} {e}" for w, _, o, e in CASES]
)
def test_no_foreign_file_is_lost(words: tuple[str, ...], command: Any, option: str, end: str, tmp_path: Path) -> None:
    foreign = tmp_path / f"mine{end}"
    foreign.write_bytes(FOREIGN)
    named = foreign.with_suffix(".png") if end == ".csv" else foreign
    code, _, stderr = run_command(*words, *required(command, option, tmp_path), option, named)
    assert foreign.read_bytes() == FOREIGN
    assert code == 2
    if words != ("measure",):  # its file goes on: only the header of a campaign may
        assert "lrm-ident did not write" in stderr, stderr
        assert foreign.name in stderr.replace("\n", "")


def test_a_campaign_leaves_a_foreign_file_as_it_is(tmp_path: Path) -> None:
    from lrm_ident.measuring.campaign.data_file import DataFile

    mine = tmp_path / "mine.csv"
    mine.write_bytes(FOREIGN + b"3,4")  # without its last line's end
    with pytest.raises(FileError, match="not that of this campaign"):
        DataFile(mine, 6)
    assert mine.read_bytes() == FOREIGN + b"3,4"


def test_a_fleet_leaves_foreign_tables(tmp_path: Path) -> None:
    (tmp_path / "prior.toml").write_text("mine = true\n")
    assert "did not write" in stderr_of("fleet", tmp_path / "none.csv", "-o", tmp_path)


def test_the_numbers_of_a_figure_spare_the_measurements(tmp_path: Path) -> None:
    data = tmp_path / "so101.csv"
    data.write_bytes(FOREIGN)
    assert "so101.csv" in stderr_of("arm", "show", "so101", "--figure", tmp_path / "so101.png")
    assert data.read_bytes() == FOREIGN
    assert not (tmp_path / "so101.png").exists()


@pytest.mark.long
def test_the_same_command_replaces_what_it_wrote(tmp_path: Path) -> None:
    words = ("arm", "show", "two-joint", "--figure", tmp_path / "arm.png", "--json", tmp_path / "arm.json")
    stdout_of(*words)
    stdout_of(*words)
    numbers = tmp_path / "arm.csv"
    numbers.write_text(numbers.read_text() + "9,9\n")  # a person has worked on it
    assert "arm.csv" in stderr_of(*words)


@pytest.mark.parametrize("link", [os.link, os.symlink])
def test_no_input_is_an_output_by_another_name(link: Callable[[Path, Path], None], tmp_path: Path) -> None:
    data = tmp_path / "run.csv"
    shutil.copy(EXAMPLE, data)
    other = tmp_path / "other.csv"
    link(data, other)
    for name in (other, tmp_path / ".." / tmp_path.name / "run.csv"):
        assert "is an input" in stderr_of("fit", data, "--arm", "lrm-lab", "-o", name)
    assert data.read_bytes() == EXAMPLE.read_bytes()


def test_a_page_is_named_so(tmp_path: Path) -> None:
    assert "name it .html" in stderr_of("report", EXAMPLE, EXAMPLE, "-o", tmp_path / "R.pdf")


@pytest.mark.long
@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["write", "edit", "remove"])), max_size=12))
def test_the_tools_own_file_is_replaced(tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[str, str]]) -> None:
    folder = tmp_path_factory.mktemp("files")
    foreign: set[str] = set()
    for number, (name, step) in enumerate(steps):
        path = folder / f"{name}.csv"
        if step == "edit":
            path.write_bytes(f"edited {number}".encode())
            foreign.add(name)
        elif step == "remove":
            path.unlink(missing_ok=True)
            foreign.discard(name)
        elif name in foreign:
            before = path.read_bytes()
            with pytest.raises(FileError, match="did not write"):
                write_text(path, f"written {number}")
            assert path.read_bytes() == before
        else:
            write_bytes(path, f"written {number}".encode())
        assert is_own(path) == (path.exists() and name not in foreign)


@pytest.mark.long
def _of_base(call: ast.Call) -> bool:
    """Is it a method of the class above, which opens no path."""
    return isinstance(call.func, ast.Attribute) and ast.unparse(call.func.value) == "super()"


@pytest.mark.long
def test_one_place_writes() -> None:
    """Only `atomic_write` opens files for writing; else only into folders of the tool's own."""
    found = []
    for path in files("lrm_ident"):
        for node in ast.walk(syntax_tree(path)):
            if not isinstance(node, ast.Call) or path.name in OWN_FOLDERS:
                continue
            method = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            texts = (a.value for a in node.args[:2] if isinstance(a, ast.Constant) and isinstance(a.value, str))
            mode = next(texts, "")
            if (method in WRITES and not _of_base(node)) or (method == "open" and set(mode) & set("wax+")):
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {place.split(":")[0] for place in found} <= {
        "lrm_ident/measuring/campaign/data_file.py",  # appends to a campaign's own file
        "lrm_ident/report/plots/style.py",  # draws into memory
        "lrm_ident/workbench/notebook.py",  # draws into memory
        "lrm_ident/data/last_error.py",  # in the user's state folder
        "lrm_ident/data/measurement_file/table_schema.py",  # `make schemas`, into the repository
    }, found


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for suffix in (".csv", ".toml"):
        shutil.copy(EXAMPLE.with_suffix(suffix), tmp_path / f"run1{suffix}")
    return tmp_path / "run1.csv"


def refused(data: Path, *words: object) -> str:
    """Message of a fit that must be refused, and that it touched no file."""
    before = {path.name: path.read_bytes() for path in data.parent.iterdir() if path.is_file()}
    said = stderr_of("fit", data, *words)
    assert {path.name: path.read_bytes() for path in data.parent.iterdir() if path.is_file()} == before
    return said


@pytest.mark.long
def test_outputs_that_would_destroy_something(data: Path) -> None:
    folder = data.parent
    (folder / "link.toml").symlink_to(data)
    shutil.copy(ROOT / "config" / "arms" / "lrm-lab.toml", folder / "arm.toml")
    for words, said in [
        (["-o", data], "is an input"),
        (["-o", folder / "link.toml"], "is an input"),
        (["--json", folder / "run1.toml"], "is an input"),
        (["-o", folder / "arm.toml"], "lrm/arm/1"),
        (["--arm", folder / "arm.toml", "-o", folder / "arm.toml"], "is an input"),
        (["-o", folder], "is a folder"),
        (["-o", "/dev/null"], "is a device"),
        (["-o", folder / "no" / "model.toml"], "cannot be written"),
        (["-o", folder / "one", "--json", folder / "one"], "the same file"),
        (["-o", folder / "one", "--json", folder / "no" / ".." / "one"], "the same file"),
    ]:
        assert said in refused(data, *words), words


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_that_may_not_be_written(data: Path) -> None:
    closed = data.parent / "closed"
    closed.mkdir(mode=0o500)
    assert "may not write" in refused(data, "-o", closed / "model.toml")


@pytest.mark.long
def test_a_link_is_followed(data: Path) -> None:
    model, link = data.parent / "model.toml", data.parent / "latest.toml"
    model.write_text('schema = "lrm/model/1"\n')
    link.symlink_to(model)
    stdout_of("fit", data, "--parameters", "option3", "-o", link)
    assert link.is_symlink()
    assert "[parameters]" in model.read_text()


@pytest.mark.slow
def test_a_model_beside_its_data_is_not_taken_for_metadata(tmp_path: Path) -> None:
    data = tmp_path / "run1.csv"
    shutil.copy(EXAMPLE, data)
    model = tmp_path / "run1.toml"
    stdout_of("fit", data, "--arm", "lrm-lab", "--parameters", "option3", "-o", model)
    assert "option" not in stdout_of("compare", model, data, "--json", tmp_path / "c.json")
    stdout_of("fit", data, "--arm", "lrm-lab", "--parameters", "option3", "-o", model)


def test_the_format_of_a_figure_is_checked_before_anything_is_read(tmp_path: Path) -> None:
    none = tmp_path / "none"
    for words in (
        ["compare", none, none],
        ["diagnose", none, none],
        ["arm", "show", none],
        ["reach", none],
        ["design", none, "-n", "9", "-o", tmp_path / "o.csv"],
    ):
        said = stderr_of(*words, "--figure", tmp_path / "why.gif")
        assert "cannot draw a .gif file; one of .png, .svg, .pdf" in said
