"""The documentation site: built without a network, links and anchors lead somewhere, nothing is loaded from afar."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from lrm_ident.cli.app import COMMANDS
from tests.conftest import ROOT

PARTS = ["Start", "How-to", "Reference", "How it works"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the built site; every warning of MkDocs is an error there."""
    pytest.importorskip("material", reason="mkdocs-material is not installed (extra 'site')")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = os.environ | {
        "NO_MKDOCS_2_WARNING": "1",
        "https_proxy": "http://127.0.0.1:9",
        "PYTHONPATH": str(ROOT),
    }
    if os.environ.get("PYTHONPATH"):
        environment["PYTHONPATH"] = os.environ["PYTHONPATH"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def test_it_has_four_parts_and_a_search(site: Path) -> None:
    index = (site / "index.html").read_text(encoding="utf-8")
    tabs = re.findall(r'class="md-tabs__link">\s*([^<]+?)\s*<', index)
    assert tabs == PARTS
    assert (site / "search" / "search_index.json").stat().st_size > 100_000


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe)[^>]*\ssrc="(https?:[^"]+)"', text)
        loaded += re.findall(r'<link[^>]*rel="(?:stylesheet|preconnect|preload)"[^>]*href="(https?:[^"]+)"', text)
        assert not loaded, page
        assert 'data-md-component="source"' not in text, "it asks a server for the repository's stars"


def test_every_command_is_in_the_reference(site: Path) -> None:
    text = (site / "reference" / "lrm-ident" / "index.html").read_text(encoding="utf-8")
    for name in COMMANDS:
        assert f"lrm-ident {name}" in text, name
    assert "lrm-ident arm export" in text
    assert "lrm goto" in (site / "reference" / "lrm" / "index.html").read_text(encoding="utf-8")


def test_the_docstrings_are_in_the_reference(site: Path) -> None:
    text = (site / "reference" / "python" / "index.html").read_text(encoding="utf-8")
    for name in ("diagnose", "Rover", "LinearEffect"):
        assert name in text


def test_every_page_is_in_the_navigation() -> None:
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    navigation = text[text.index("\nnav:") :]
    for page in sorted((ROOT / "docs").rglob("*.md")):
        assert page.relative_to(ROOT / "docs").as_posix() in navigation, page
    assert [next(iter(part)) for part in yaml.safe_load(navigation)["nav"]] == PARTS


def test_what_the_site_needs_is_pinned() -> None:
    pinned = {
        line.split("==")[0].lower() for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line
    }
    assert {"mkdocs", "mkdocs-material", "mkdocstrings", "mkdocstrings-python", "pymdown-extensions"} <= pinned
