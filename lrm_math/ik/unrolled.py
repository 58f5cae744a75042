"""A linkage written out as Python: every slot's frame, axis and load in straight lines, without loops over slots.

One candidate costs two thirds of what the same recursion costs in a loop: nothing is packed, unpacked or asked, and
products with what is zero in this arm are left out (models customised to an arm: Khalil & Kleinfinger 1987).

In the text, a, b, c and p are the columns and the origin of the frame reached so far, each with rows x, y and z.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import cos, sin
from typing import Any

import numpy as np

from lrm_math.arrays import Array

ROWS = "xyz"
COLUMNS = "abc"
FRAME = ", ".join(f"{column}{row}" for column in "abcp" for row in ROWS)
START = f"{FRAME} = {', '.join(map(str, np.eye(4)[:, :3].ravel().tolist()))}"


def tool_text(welds: Sequence[Array], axes: Sequence[int]) -> str:
    """`tool(amounts)`: the tool's frame at the amounts (V,) of the slots (rad).

    Args:
        welds: (4, 4), from each slot to the next, and from the last to the tool's frame.
        axes: number from 0 of the axis that each slot turns about.
    """
    lines = [_taken("q", len(axes), "amounts"), START]
    for v, axis in enumerate(axes):
        lines += [*_moved(welds[v]), *_turned(v, axis)]
    return _function("tool(amounts)", [*lines, *_moved(welds[-1])], f"({FRAME})")


def stand_text(
    welds: Sequence[Array],
    axes: Sequence[int],
    stands: Sequence[int],
    counted: Sequence[int],
    gravity: Sequence[float],
) -> str:
    """`stand(amounts, cargo)`: the tool's frame, axes and origins of the slots, and gravity's load on them.

    Args:
        stands: how many slots each body stands behind, ascending.
        counted: the first body that each slot's load counts. gravity: m/s².
    """
    slots, bodies = range(len(axes)), range(len(stands))
    lines = [_taken("q", len(axes), "amounts"), *(f"u{b}, v{b}, w{b}, m{b} = cargo[{b}]" for b in bodies), START]
    lines += [_moment(b) for b in bodies if stands[b] == 0]
    for v, axis in enumerate(axes):
        lines += _moved(welds[v])
        lines += [f"i{v}, j{v}, k{v}, o{v}, r{v}, s{v} = {', '.join(COLUMNS[axis] + row for row in ROWS)}, px, py, pz"]
        lines += _turned(v, axis)
        lines += [_moment(b) for b in bodies if stands[b] == v + 1]
    lines += _moved(welds[-1])
    lines += ["x = y = z = m = 0.0", *_loads(counted, len(stands), [float(g) for g in gravity])]
    axis_list = ", ".join(f"(i{v}, j{v}, k{v})" for v in slots)
    origin_list = ", ".join(f"(o{v}, r{v}, s{v})" for v in slots)
    tau_list = ", ".join(f"t{v}" for v in slots)
    return _function("stand(amounts, cargo)", lines, f"({FRAME}), [{axis_list}], [{origin_list}], [{tau_list}]")


def function(text: str, name: str) -> Any:
    """The function of that name in a text, which holds nothing but what is written here and numbers of the model."""
    names: dict[str, Any] = {"cos": cos, "sin": sin}
    exec(compile(text, f"<{name}, written out>", "exec"), names)
    return names[name]


def _function(head: str, lines: Sequence[str], answer: str) -> str:
    return "\n    ".join([f"def {head}:", *lines, f"return {answer}\n"])


def _taken(letter: str, count: int, source: str) -> str:
    return f"[{', '.join(f'{letter}{v}' for v in range(count))}] = {source}"


def _moved(weld: Array) -> Iterator[str]:
    """Along a rigid piece: the shift, then the turn."""
    for row in ROWS:
        if shift := _sum(row, weld[:3, 3].tolist()):
            yield f"p{row} += {shift}"
    changed = [j for j in range(3) if not np.array_equal(weld[:3, j], np.eye(3)[j])]
    for row in ROWS if changed else ():
        old = ", ".join(_sum(row, weld[:3, j].tolist()) for j in changed)
        yield f"{', '.join(COLUMNS[j] + row for j in changed)} = {old}"


def _sum(row: str, shares: Sequence[float]) -> str:
    """One row of the columns' sum by shares, empty where all are zero."""
    return " + ".join(f"{share!r} * {column}{row}" for column, share in zip(COLUMNS, shares, strict=True) if share)


def _turned(v: int, axis: int) -> Iterator[str]:
    """About an axis of the frame, by the amount of slot v."""
    one, other = COLUMNS[(axis + 1) % 3], COLUMNS[(axis + 2) % 3]
    yield f"cq, sq = cos(q{v}), sin(q{v})"
    for row in ROWS:
        yield f"{one}{row}, {other}{row} = cq * {one}{row} + sq * {other}{row}, cq * {other}{row} - sq * {one}{row}"


def _moment(b: int) -> str:
    """First mass moment of body b about the base's origin (kg m)."""
    parts = (f"a{row} * u{b} + b{row} * v{b} + c{row} * w{b} + p{row} * m{b}" for row in ROWS)
    return f"x{b}, y{b}, z{b} = {', '.join(parts)}"


def _loads(counted: Sequence[int], bodies: int, gravity: Sequence[float]) -> Iterator[str]:
    """Gravity's load on every slot, from the last to the first: axis · (moment of what it carries × gravity)."""
    gx, gy, gz = map(repr, gravity)
    added = bodies
    for v in reversed(range(len(counted))):
        for b in reversed(range(counted[v], added)):
            yield f"x, y, z, m = x + x{b}, y + y{b}, z + z{b}, m + m{b}"
        added = min(added, counted[v])
        yield f"dx, dy, dz = x - m * o{v}, y - m * r{v}, z - m * s{v}"
        yield (
            f"t{v} = i{v} * (dy * {gz} - dz * {gy}) + j{v} * (dz * {gx} - dx * {gz}) + k{v} * (dx * {gy} - dy * {gx})"
        )
