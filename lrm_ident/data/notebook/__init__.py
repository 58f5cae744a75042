"""Results draw themselves in a notebook (Jupyter, marimo), which asks an object for `_repr_html_`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

PICTURES = "lrm_ident.workbench.notebook"
"""The module above all others that makes the HTML; it is looked up when a notebook asks, and not before."""


class ShownInNotebook:
    """A result that a notebook shows as its table and picture."""

    def _repr_html_(self) -> str:
        return str(import_module(PICTURES).html_of(self))


@dataclass(frozen=True)
class NotebookPage:
    """The page of a report on a study, made when a notebook shows it."""

    study: object

    def _repr_html_(self) -> str:
        return str(import_module(PICTURES).page_of(self.study))
