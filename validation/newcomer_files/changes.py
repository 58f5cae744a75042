"""Random single changes of files: a unit, a sign, an order, a type, a gap, a duplicate, the encoding."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from validation.newcomer_files.healthy import NewcomerFiles

NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?")
POSITION = ("x_mm", "y_mm", "z_mm")
BAD_CELLS = ("n/a", "NaN", "inf", "--", "", "12,5", "1O", "true", "'7'", "1.2.3", "#REF!", "1e999")


@dataclass(frozen=True)
class FileChange:
    """Files after one change; `words` name it in an error or a notice, any of them."""

    what: str
    files: NewcomerFiles
    words: tuple[str, ...]


Change = Callable[[NewcomerFiles, np.random.Generator], FileChange]


def _scaled(files: NewcomerFiles, names: list[str], factor: float) -> NewcomerFiles:
    for name in names:
        files = files.with_column(name, lambda values: values * factor)
    return files


def _pick(rng: np.random.Generator, *values: str) -> str:
    return str(rng.choice(values))


def unit(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """Columns, keys or the arm file in another unit."""
    angles, factor = files.angles, float(rng.choice([1e-3, 0.1, 1 / 25.4, 1e3]))
    one, axis = _pick(rng, *angles), _pick(rng, *POSITION)
    kind = _pick(rng, "positions", "angles", "angle", "axis", "payload", "time", "noise", "lengths", "masses", "start")
    units = ("metre", "inch", "centimetre", "micrometre", "unit")
    if kind == "positions":
        return FileChange(f"positions x {factor:g}", _scaled(files, [*POSITION], factor), units)
    if kind == "angles":
        return FileChange("angles in rad", _scaled(files, angles, np.pi / 180), ("radian", "angle_unit"))
    if kind == "angle":
        number = one[1:-4]
        words = (one, f"joint {number}", f"joint{number}", "radian", "which column is which joint")
        return FileChange(f"{one} in rad", _scaled(files, [one], np.pi / 180), words)
    if kind == "axis":
        return FileChange(f"{axis} in m", _scaled(files, [axis], 1e-3), (axis, *units, "collapse", "shrinks"))
    if kind == "payload":
        return FileChange("payload in kg", _scaled(files, ["payload_g"], 1e-3), ("payload",))
    if kind == "time":
        return FileChange("time in ms since 1970", _scaled(files, ["t_s"], 1.1e10), ("t_s",))
    if kind == "noise":
        text = re.sub(
            r"(noise_sd_mm = )(\S+)", lambda m: f"{m[1]}{float(m[2]) * float(rng.choice([1e-3, 1e3]))}", files.metadata
        )
        return FileChange("noise in another unit", replace(files, metadata=text), ("noise_sd_mm", "noise"))
    if kind == "start":
        text = re.sub(r"start_q_deg = .*", "start_q_deg = [200.0]", files.metadata)
        return FileChange("start of one joint", replace(files, metadata=text), ("start_q_deg",))
    key = r"\w+_mm" if kind == "lengths" else "mass_g"
    amount = float(rng.choice([1e-3, 1e3]))
    said = ("the arm is", "should be less", "lengths") if kind == "lengths" else ("mass", "weigh")
    return FileChange(f"arm's {kind} x {amount:g}", replace(files, arm=scaled_arm(files.arm, key, amount)), said)


def scaled_arm(text: str, key: str, factor: float) -> str:
    """An arm file with the numbers of some keys multiplied."""

    def line(found: re.Match[str]) -> str:
        return found[1] + NUMBER.sub(lambda number: f"{float(number[0]) * factor:.8f}", found[2])

    return re.sub(rf"^(\s*(?:{key})\s*=\s*)([^#\n]*)", line, text, flags=re.MULTILINE)


def sign(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """A column, or one cell of it, with the other sign."""
    name = _pick(rng, *files.angles, *POSITION)
    if rng.random() < 0.6:
        about = (name, f"joint {name[1:-4]}", "mirrored", "swapped", "turned", "axes", "counted the other way")
        return FileChange(f"-{name}", _scaled(files, [name], -1.0), about)
    row, place = _one(files, rng), files.column(name)
    rows = [list(cells) for cells in files.rows]
    rows[row][place] = f"{-float(rows[row][place]):g}"
    return FileChange(f"-{name} in one row", files.with_rows(rows), (*_named(files, row), name))


def order(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """Two columns, two rows' positions, or all rows in another order."""
    kind, rows = _pick(rng, "joints", "axes", "rows", "positions", "columns"), [list(cells) for cells in files.rows]
    if kind in ("joints", "axes"):
        names = rng.choice(files.angles if kind == "joints" else POSITION, 2, replace=False)
        one, other = (files.column(str(name)) for name in names)
        for cells in rows:
            cells[one], cells[other] = cells[other], cells[one]
        numbers = (f"{str(names[0])[1:-4]}", f"{str(names[1])[1:-4]}")
        words = (
            "swapped",
            "mirrored",
            "turned",
            "another frame",
            "is it another arm",
            "joints",
            *(f"joint {n}" for n in numbers),
        )
        return FileChange(f"{names[0]} and {names[1]} swapped", files.with_rows(rows), words)
    if kind == "rows":
        rng.shuffle(rows)
        return FileChange("rows shuffled", files.with_rows(rows), ("ascend", "backwards", "order"))
    if kind == "positions":
        row, places = _one(files, rng, last=False), [files.column(name) for name in POSITION]
        for place in places:
            rows[row][place], rows[row + 1][place] = rows[row + 1][place], rows[row][place]
        return FileChange(
            "positions of two rows swapped", files.with_rows(rows), (*_named(files, row), *_named(files, row + 1))
        )
    turned = [int(k) for k in rng.permutation(len(files.header))]
    moved = [[cells[k] for k in turned] for cells in rows]
    return FileChange("columns with their names moved", files.with_rows(moved, [files.header[k] for k in turned]), ())


def wrong_type(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """A cell that is no number, or a header of another name."""
    place, rows = int(rng.integers(len(files.header))), [list(cells) for cells in files.rows]
    if rng.random() < 0.25:
        header = list(files.header)
        header[place] = _pick(rng, "", "foo", header[place].upper(), header[place].rsplit("_", 1)[0])
        words = (files.header[place], "header", "columns not used", "read as", "the last joint", "cells")
        return FileChange(
            f"column {files.header[place]} called '{header[place]}'", files.with_rows(rows, header), words
        )
    row, cell = _one(files, rng), _pick(rng, *BAD_CELLS)
    rows[row][place] = cell
    return FileChange(f"'{cell}' in {files.header[place]}", files.with_rows(rows), (f"line {row + 2}",))


def gap(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """Rows, a column, positions or the end missing."""
    kind, rows, row = (
        _pick(rng, "rows", "column", "lost", "cut", "few"),
        [list(c) for c in files.rows],
        _one(files, rng),
    )
    if kind == "rows":
        kept = [cells for k, cells in enumerate(rows) if not row <= k < row + int(rng.integers(1, 5))]
        return FileChange("rows missing", files.with_rows(kept), ("lacks a pose",))
    if kind == "few":
        return FileChange("few rows", files.with_rows(rows[: int(rng.integers(0, 20))]), ("poses", "rows"))
    if kind == "column":
        place = int(rng.integers(len(files.header)))
        less = [[c for k, c in enumerate(cells) if k != place] for cells in rows]
        name = files.header[place]
        header = [c for c in files.header if c != name]
        return FileChange(f"no column {name}", files.with_rows(less, header), (name, f"joint {name[1:-4]}"))
    if kind == "lost":
        for k in rng.choice(len(rows), int(rng.integers(1, 6)), replace=False):
            for name in POSITION:
                rows[k][files.column(name)] = "0"
        return FileChange("tracker lost", files.with_rows(rows), ("0, 0, 0",))
    text = files.text()
    cut = text[: int(rng.integers(len(text) // 2, len(text)))]
    return FileChange("file cut off", replace(files, encoded=cut.encode()), ("line", "complete", "poses"))


def duplicate(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """A row, a column, or a position twice."""
    kind, rows, row = (
        _pick(rng, "row", "column", "stale", "renumbered"),
        [list(c) for c in files.rows],
        _one(files, rng),
    )
    if kind == "row":
        rows.insert(row, list(rows[row]))
        return FileChange("a row twice", files.with_rows(rows), ("already",))
    if kind == "renumbered":
        rows.append([str(len(rows) + 1), *rows[row][1:]])
        return FileChange("a row again at the end", files.with_rows(rows), ("backwards",))
    if kind == "column":
        place = int(rng.integers(len(files.header)))
        doubled = [[*cells, cells[place]] for cells in rows]
        header = [*files.header, files.header[place]]
        return FileChange(f"{files.header[place]} twice", files.with_rows(doubled, header), ("twice",))
    for later in range(row + 1, min(row + 1 + int(rng.integers(1, 4)), len(rows))):
        for name in POSITION:
            rows[later][files.column(name)] = rows[row][files.column(name)]
    named = [word for k in range(row, min(row + 4, len(rows))) for word in _named(files, k)]
    return FileChange("position stands still", files.with_rows(rows), (*named, "stands still"))


def encoding(files: NewcomerFiles, rng: np.random.Generator) -> FileChange:
    """The same table in another encoding or dialect."""
    text = files.text()
    commas = files.text(";").replace(".", ",")
    dialects: Mapping[str, bytes] = {
        "utf-16": text.encode("utf-16"),
        "byte order mark": b"\xef\xbb\xbf" + text.encode(),
        "latin-1": ("# Prüfstand °\n" + text).encode("latin-1"),
        "crlf": text.replace("\n", "\r\n").encode(),
        "decimal commas": commas.encode(),
        "tabs": files.text("\t").encode(),
        "sep line": ("sep=;\n" + files.text(";")).encode(),
        "quotes": re.sub(r"([^,\n]+)", r'"\1"', text).encode(),
        "blank lines": text.replace("\n", "\n\n").encode(),
        "spaces": text.replace(",", " , ").encode(),
        "binary": bytes(rng.integers(0, 256, 2000, dtype=np.uint8)),
        "empty": b"",
    }
    kind = _pick(rng, *dialects)
    return FileChange(kind, replace(files, encoded=dialects[kind]), ("text", "header", "read", "row", "UTF", "column"))


def _one(files: NewcomerFiles, rng: np.random.Generator, last: bool = True) -> int:
    return int(rng.integers(len(files.rows) - (0 if last else 1)))


def _named(files: NewcomerFiles, row: int) -> tuple[str, ...]:
    number = files.rows[row][0]
    return f"pose {number}:", f"pose: {number}", f"pose: {number},", f"--leave-out {number}", f",{number} "


CHANGES: Mapping[str, Change] = {
    "unit": unit,
    "sign": sign,
    "order": order,
    "type": wrong_type,
    "gap": gap,
    "duplicate": duplicate,
    "encoding": encoding,
}
