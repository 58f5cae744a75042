"""A page at true scale with the places of the sockets, to be drilled into a plate."""

from __future__ import annotations

from collections.abc import Iterator

from lrm_ident.measuring.pdf_page import MARGIN, RULER, paper_size, pdf_file, ruler_of_100_mm, words_at
from lrm_ident.measuring.sockets.board import SocketBoard
from lrm_math.errors import LrmError

CROSS = 8.0  # mm


def drill_plan(board: SocketBoard, paper: str) -> bytes:
    """A page (PDF 1.4) with a cross at each socket of the plate. Raises `LrmError`: no such paper, or too small."""
    width, height = paper_size(paper)
    if board.length_mm > width - 4 * MARGIN or board.width_mm > height - 90.0:
        need = f"{board.length_mm:g} x {board.width_mm:g} mm"
        raise LrmError(f"sockets {need} apart do not fit on {paper}; choose a shorter --length-mm or --width-mm")
    return pdf_file(width, height, _drawing(board, width, height))


def _drawing(board: SocketBoard, width: float, height: float) -> Iterator[str]:
    """Operators of the page; lengths in mm."""
    x_left, bottom = (width - board.length_mm) / 2.0, height - 2 * MARGIN - board.width_mm
    yield "0.15 w"
    for name, (x, y, _) in board.points.items():
        at_x, at_y = x_left + x, bottom + y
        yield f"{at_x - CROSS:.4f} {at_y:.4f} m {at_x + CROSS:.4f} {at_y:.4f} l S"
        yield f"{at_x:.4f} {at_y - CROSS:.4f} m {at_x:.4f} {at_y + CROSS:.4f} l S"
        yield words_at(at_x + 2.0, at_y + 2.0, name)
    at = bottom - 18.0
    for words in (
        f"A-B {board.length_mm:g} mm, A-D {board.width_mm:g} mm. Centre-punch each cross; drill, then countersink "
        f"90 deg to {board.opening_mm:g} mm.",
        "Measure all six distances afterwards and state them under [distances].",
    ):
        yield words_at((width - RULER) / 2.0 - 20.0, at, words)
        at -= 6.0
    yield from ruler_of_100_mm((width - RULER) / 2.0, at - 12.0)
