"""Style that all figures share: colours for any colour vision (Okabe & Ito 2008), file formats, axes, writing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

from lrm_ident.data.atomic_write import write_bytes
from lrm_math.errors import FileError

if TYPE_CHECKING:  # matplotlib takes half a second to load
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS, DPI = (".png", ".svg", ".pdf"), 110
NOMINAL, MODEL, HELD_OUT, GREEN = "#888888", "#0072b2", "#d55e00", "#009e73"
TITLE_LINE = 56
"""Characters of a title that one panel has room for."""


def check_format(path: Path) -> None:
    """Raises `FileError` if figures of this kind cannot be drawn."""
    if path.suffix.lower() not in FORMATS:
        raise FileError(path, "", f"cannot draw a {path.suffix or 'nameless'} file", f"one of {', '.join(FORMATS)}")


@contextmanager
def figure_file(path: Path | None, width: float, height: float) -> Iterator[Figure]:
    """An empty figure (inches) that is written to `path` if there is one, whole or not at all. Raises `FileError`."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    if path is not None:
        check_format(path)
    with rc_context({"axes.titlesize": 11, "grid.alpha": 0.3, "legend.fontsize": 9}):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
    if path is not None:
        drawn = BytesIO()
        figure.savefig(drawn, dpi=DPI, format=path.suffix[1:].lower())
        write_bytes(path, drawn.getvalue())


def finish(axes: Axes, x: str, y: str, title: str = "", legend: bool = True) -> None:
    """Labels, title, grid and legend."""
    axes.set(xlabel=x, ylabel=y)
    axes.set_title(fill(title, TITLE_LINE))
    axes.grid()
    if legend:
        legend_below(axes, 2)


def legend_below(axes: Axes, columns: int = 1) -> None:
    """The legend under the axis, where it hides no bar and no point."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=columns, frameon=False)


def plain_number(value: float, _: float) -> str:
    """A tick label without powers of ten."""
    return f"{value:g}"
