"""Prints the help texts of lrm-ident and lrm as JSON, of the checkout on the path: [name, text] each."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from typing import Any


def of_click(command: Any, name: str) -> Iterator[tuple[str, str]]:
    """A command's text, those of its options, and those of its own commands."""
    yield name, command.help or ""
    for parameter in command.params:
        label = parameter.opts[-1] if parameter.opts else str(parameter.name)
        yield f"{name} {label}", getattr(parameter, "help", None) or ""
    for each in getattr(command, "list_commands", lambda _: [])(None):
        yield from of_click(command.get_command(None, each), f"{name} {each}")


def of_argparse(parser: argparse.ArgumentParser, name: str) -> Iterator[tuple[str, str]]:
    """The same of a parser of the standard library."""
    yield name, parser.description or ""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for each in action._choices_actions:
                yield f"{name} {each.dest}", each.help or ""
            for word, inner in action.choices.items():
                yield from of_argparse(inner, f"{name} {word}")
        elif action.help and action.help != argparse.SUPPRESS:
            yield f"{name} {(action.option_strings or [action.dest])[-1]}", action.help


def help_texts() -> list[tuple[str, str]]:
    """Help of both command lines, without examples."""
    from typer.main import get_command

    from lrm_ident.cli.app import app
    from lrmd.cli.app import parser

    texts = [*of_click(get_command(app), "lrm-ident"), *of_argparse(parser(), "lrm")]
    return [(name, without_examples(text)) for name, text in texts]


def without_examples(text: str) -> str:
    """Lines that are not indented, up to what click leaves as it is broken."""
    return "\n".join(line for line in text.split("\b")[0].splitlines() if not line.startswith("  "))


def main() -> None:
    """Prints them."""
    print(json.dumps(help_texts()))


if __name__ == "__main__":
    main()
