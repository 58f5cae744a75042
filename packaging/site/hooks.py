"""Hooks of the documentation site: pages made from the code, and links to files that are not pages.

MkDocs loads this file by its path (mkdocs.yml).
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[2]
os.environ["COLUMNS"] = "80"  # the width of what argparse prints
LINK = re.compile(r"(?<=\]\()(\.\.?/[^)#\s]+)(#[^)\s]*)?(?=\))")
"""A relative link that leads out of the folder of its page."""
PYTHON_PAGE = """# Python

What `import lrm_ident as lrm` gives, the client of the daemon, and the classes that effects of your own derive from.

::: lrm_ident.study.api

::: lrm_ident.study.study
    options: {members: [Study]}

::: lrm_ident.report.plots.plot

::: lrmd.client
    options: {members: [Rover]}

::: lrm_math.effects.base
    options: {members: [Effect, LinearEffect, JointEffect, Parameter, Description, Excitation]}
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made from the code."""
    pages = {"lrm-ident": ident_page(), "lrm": daemon_page(), "python": PYTHON_PAGE}
    for name, text in pages.items():
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Links to files of the repository that are no pages lead to the repository."""
    folder = Path(config.docs_dir, page.file.src_uri).parent

    def at_repository(link: re.Match[str]) -> str:
        """The same link, or the address of the file that it names."""
        target = (folder / link[1]).resolve()
        if target.is_relative_to(config.docs_dir):
            return link[0]
        if not target.exists():
            raise PluginError(f"{page.file.src_uri}: there is no {link[1]}")
        kind = "tree" if target.is_dir() else "blob"
        return f"{config.extra['repository']}/{kind}/main/{target.relative_to(ROOT).as_posix()}{link[2] or ''}"

    return LINK.sub(at_repository, markdown)


def ident_page() -> str:
    """Help of every command of `lrm-ident`, sorted as `lrm-ident --help` sorts them."""
    from typer.main import get_command

    from lrm_ident.cli.app import SECTIONS, app

    group: Any = get_command(app)
    lines = ["# Commands of lrm-ident", "Each command prints this with `--help`.", ""]
    for title, section in SECTIONS.items():
        lines += [f"## {title}", ""]
        for listed in section:
            lines += [f"### {listed.name}", "", listed.summary, ""]
            for words, command in _commands(f"lrm-ident {listed.name}", group.get_command(None, listed.name)):
                lines += ["```text", _help(command, words), "```", ""]
    return "\n".join(lines)


def _commands(words: str, command: Any) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if not inner:
        yield words, command
        return
    for name, each in inner.items():
        yield from _commands(f"{words} {name}", each)


def _help(command: Any, words: str) -> str:
    context = command.make_context(words, [], resilient_parsing=True, max_content_width=80, terminal_width=80)
    return str(command.get_help(context)).strip()


def daemon_page() -> str:
    """Help of the daemon's programs."""
    from lrmd.cli.app import main, parser
    from lrmd.main import main as daemon

    (inner,) = (each for each in parser()._actions if isinstance(each.choices, dict))
    lines = ["# Commands of the daemon", "", "## lrmd", "", *_printed(daemon), "## lrm", "", *_printed(main)]
    for name in inner.choices or ():
        lines += [f"### lrm {name}", "", *_printed(main, str(name))]
    return "\n".join(lines)


def _printed(program: Callable[[list[str]], object], *words: str) -> list[str]:
    """What a program of argparse prints as its help."""
    out = io.StringIO()
    with redirect_stdout(out), suppress(SystemExit):
        program([*words, "--help"])
    return ["```text", out.getvalue().strip(), "```", ""]
