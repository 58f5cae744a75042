"""Pages (PDF 1.4) at true scale: words, a ruler to check the print; lengths in mm."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from lrm_math.errors import LrmError

POINTS_PER_MM = 72.0 / 25.4
PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}
MARGIN = 12.0  # mm of the page
RULER = 100  # mm


def paper_size(paper: str) -> tuple[float, float]:
    """Width and height of a paper (mm). Raises `LrmError`: no such paper."""
    if paper not in PAPERS:
        raise LrmError(f"no paper '{paper}'; one of {', '.join(PAPERS)}")
    return PAPERS[paper]


def ruler_of_100_mm(start: float, at: float) -> Iterator[str]:
    """Operators of a line of 100 mm from (start, at), and what to do with it."""
    yield "0.2 w"
    for mm in range(RULER + 1):
        length = 5.0 if mm % 10 == 0 else 3.5 if mm % 5 == 0 else 2.0
        yield f"{start + mm:.4f} {at:.4f} m {start + mm:.4f} {at + length:.4f} l S"
    yield f"{start:.4f} {at:.4f} m {start + RULER:.4f} {at:.4f} l S"
    yield words_at(start, at - 5.0, "This line is 100 mm. Print at 100 % ('actual size'), then lay a ruler on it.")


def words_at(x: float, y: float, words: str) -> str:
    """Operator that writes words at a place."""
    escaped = words.replace("(", r"\(").replace(")", r"\)")
    return f"BT /F 3.2 Tf {x:.4f} {y:.4f} Td ({escaped}) Tj ET"


def pdf_file(width: float, height: float, drawing: Iterable[str], pictures: Sequence[bytes] = ()) -> bytes:
    """A file of one page: operators that draw it, lengths in mm; `pictures`: their `/Picture1` and so on."""
    scale = f"{POINTS_PER_MM:.6f} 0 0 {POINTS_PER_MM:.6f} 0 0 cm"
    content = "\n".join([scale, *drawing]).encode("latin-1")
    box = f"[0 0 {width * POINTS_PER_MM:.4f} {height * POINTS_PER_MM:.4f}]"
    named = "".join(f"/Picture{number} {number + 5} 0 R " for number in range(1, len(pictures) + 1))
    resources = f"<< /XObject << {named}>> /Font << /F 5 0 R >> >>"
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R /Resources {resources} >>".encode(),
        f"<< /Length {len(content)} >>\nstream\n".encode() + content + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        *pictures,
    ]
    out, places = b"%PDF-1.4\n", []
    for number, body in enumerate(objects, start=1):
        places.append(len(out))
        out += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    head = f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}"
    tail = f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(out)}\n%%EOF\n"
    return out + head.encode() + tail.encode()
