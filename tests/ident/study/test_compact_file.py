"""A model file has an array to a line, and holds the same as one with a number to a line."""

from __future__ import annotations

from pathlib import Path

import pytest
import tomli_w

import lrm_ident as lrm
from lrm_ident.study.model_history import model_text
from lrm_math.model.model_file import ModelFile, as_tables
from lrm_math.toml_file import read_toml

pytestmark = pytest.mark.long


def test_a_model_file_is_short_and_older_files_read_the_same(tmp_path: Path, example_study: lrm.Study) -> None:
    file = example_study.file
    long, short = tmp_path / "long.toml", tmp_path / "short.toml"
    long.write_text(tomli_w.dumps(as_tables(file)))
    short.write_text(model_text(file))
    assert read_toml(short, ModelFile) == read_toml(long, ModelFile) == file
    lines = [len(path.read_text().splitlines()) for path in (short, long)]
    assert lines[0] < 8 * len(file.parameters) < lines[1] / 4
