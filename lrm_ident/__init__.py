"""Offline tool: identify the model of a robot arm from measured TCP positions, and find the effect that is missing.

The public functions are those of `lrm_ident.study.api`, and `plot`. They are loaded at their first use, so that
`lrm-ident` can name the extra to install where it is missing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lrm_ident.report.plots.plot import plot
    from lrm_ident.study.api import (
        EXAMPLE,
        Reading,
        Study,
        add,
        auto,
        catalogue_with,
        compare,
        diagnose,
        fit,
        load,
        load_model,
        load_poses,
        predict,
        read_study,
        save,
        transfer,
    )

__all__ = [
    "EXAMPLE",
    "Reading",
    "Study",
    "add",
    "auto",
    "catalogue_with",
    "compare",
    "diagnose",
    "fit",
    "load",
    "load_model",
    "load_poses",
    "plot",
    "predict",
    "read_study",
    "save",
    "transfer",
]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'lrm_ident' has no attribute '{name}'")
    home = "lrm_ident.report.plots.plot" if name == "plot" else "lrm_ident.study.api"
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
