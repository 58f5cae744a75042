"""The command `explain`: an entry of the glossary, or an effect, in plain words."""

from __future__ import annotations

from typing import Annotated

from rich.text import Text
from typer import Argument

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import show
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.report.effects import effect_blocks, listed
from lrm_ident.report.glossary import TERMS, term_named
from lrm_math.effects.reference import EffectRef


@command
def explain(
    word: Annotated[str | None, Argument(metavar="WORD", help="A term or an effect; all terms if not given.")] = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Explain a word that the commands use.

    \b
      lrm-ident explain "held-out error"
      lrm-ident explain backlash
    """
    if word is None:
        if show_all:
            show(*(Text.assemble((term.name, "bold"), f": {term.meaning}") for term in TERMS))
        else:
            show(*listed("lrm-ident explain WORD", "Terms", [term.name for term in TERMS]))
        return
    kinds = {kind.id: kind for kind in catalogue_with(None)}
    name = EffectRef.parse(word).id
    if name in kinds:
        show(*effect_blocks(kinds[name], in_full=True))
        return
    term = term_named(word)
    show(Text.assemble((term.name, "bold"), f": {term.meaning}"))
    if term.others:
        show(f"    also: {', '.join(term.others)}")
