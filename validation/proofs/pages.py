"""Pages of docs/proofs, made from the results beside them: words are written here, every number comes from a file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

from validation.proofs.result_file import FOLDER, ProofResult, read

GIVEN_BY = "{command}, on {date}, code of commit {commit}; {machine}."


@dataclass(frozen=True)
class ProofPage:
    """A page: its title, what the table says in a sentence or two, how to read it, and the result that it shows."""

    name: str
    title: str
    conclusion: str
    reading: str

    def text(self, result: ProofResult) -> str:
        """The page."""
        given = f"*{GIVEN_BY.format(**{**vars(result), 'command': f'`{result.command}`'})}*"
        parts = [f"# {self.title}", self.conclusion, _table(result), given, self.reading]
        return "\n\n".join(filter(None, parts)) + "\n"


WORDS = tomllib.loads(Path(__file__).with_name("pages.toml").read_text(encoding="utf-8"))
PAGES = tuple(ProofPage(name, **words) for name, words in WORDS.items())


def pages(folder: Path = FOLDER) -> dict[Path, str]:
    """The text of every page of which the result is there, by its file."""
    results = {page: folder / f"{page.name}.json" for page in PAGES}
    return {path.with_suffix(".md"): page.text(read(path)) for page, path in results.items() if path.exists()}


def _table(result: ProofResult) -> str:
    numbers = [all(isinstance(row[at], int | float | None) for row in result.rows) for at in range(len(result.columns))]
    head = "| " + " | ".join(result.columns) + " |"
    rule = "|" + "|".join("---:" if number else "---" for number in numbers) + "|"
    return "\n".join([head, rule, *("| " + " | ".join(map(_cell, row)) + " |" for row in result.rows)])


def _cell(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, list):
        return "<br>".join(_test(str(one)) for one in value)
    if str(value).endswith(".png"):
        return f"![First view of the report of {Path(str(value)).stem}](../pictures/gallery/{value})"
    return str(value).replace("|", "\\|")


def _test(name: str) -> str:
    """A test as a link to its file."""
    file, _, test = name.partition("::")
    return f"[{test.removeprefix('test_').replace('_', ' ')}](../../{file})"
