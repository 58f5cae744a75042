"""Sets of columns side by side, and what a linearised fit explains of them: one of them a cause that may be missing.

Every set is tried alone, so of the products of columns only those within a set are kept; sets of one size stand
together, so that their normal equations are solved in one call. Rows stand fold by fold, so that a fold's are a slice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array

NO_ROWS = slice(0)


@dataclass(frozen=True, eq=False)
class FoldSplit:
    """Rows that parameters are estimated from, and rows that the estimate is for: of a fold, or all from all.

    Attributes:
        poses: those that are predicted.
        absent: rows left out of the estimate.
        predicted_rows: T rows that are predicted.
        fitted: (T, P), what amounts along orthonormal directions of the fitted parameters predict.
        predictor: (T, p), what amounts along p directions of what was taken into the fit later predict.
        left: (T,), what the estimate leaves of the residual.
    """

    poses: NDArray[np.int64]
    absent: slice
    predicted_rows: slice
    fitted: Array
    predictor: Array
    left: Array


@dataclass(frozen=True, eq=False)
class EqualSizedSets:
    """Sets of one size: their `numbers` (n,), the first of their columns, the first of their places among all sets in
    the order of columns, and their `size`."""

    numbers: NDArray[np.int64]
    start: int
    place: int
    size: int

    @property
    def places(self) -> slice:
        """Their places among all sets in the order of columns."""
        return slice(self.place, self.place + len(self.numbers))

    @property
    def columns(self) -> slice:
        """Places of their columns."""
        return slice(self.start, self.start + len(self.numbers) * self.size)


@dataclass(frozen=True, eq=False)
class ColumnSets:
    """S sets of M columns in all, with a fit projected out.

    Attributes:
        columns: (R N, M), fold by fold, without what the fitted parameters explain of them in all rows.
        held_out: (R N, M), without what these explain if they are estimated from the other folds.
        explained: (parts, p, M), their amounts along each part's directions of what was taken later.
        stacks: the sets by size, in the order of their columns.
        along: (parts, M), products with the residual over the rows of the estimate, without what is explained of both.
        grams: for each stack (parts, n, m, m), the same of each set's columns.
    """

    columns: Array
    held_out: Array
    explained: Array
    stacks: tuple[EqualSizedSets, ...]
    along: Array
    grams: tuple[Array, ...]

    def __len__(self) -> int:
        return sum(len(stack.numbers) for stack in self.stacks)

    def __iter__(self) -> Iterator[ColumnSets]:
        """Each set alone, by its number."""
        of_number = {int(number): (stack, i) for stack in self.stacks for i, number in enumerate(stack.numbers)}
        grams = dict(zip(self.stacks, self.grams, strict=True))
        for number in sorted(of_number):
            stack, i = of_number[number]
            alone = EqualSizedSets(np.zeros(1, dtype=np.int64), 0, 0, stack.size)
            own = slice(stack.start + i * stack.size, stack.start + (i + 1) * stack.size)
            rows = self.columns[:, own], self.held_out[:, own], self.explained[:, :, own]
            yield ColumnSets(*rows, (alone,), self.along[:, own], (grams[stack][:, i : i + 1],))

    @property
    def starts(self) -> NDArray[np.int64]:
        """(S,), first column of each set, in the order of the columns."""
        return np.concatenate([stack.start + stack.size * np.arange(len(stack.numbers)) for stack in self.stacks])

    @property
    def numbers(self) -> NDArray[np.int64]:
        """(S,), number of each set, in the order of the columns."""
        return np.concatenate([stack.numbers for stack in self.stacks])

    def products(self, parts: Sequence[FoldSplit], columns: Array) -> Array:
        """(parts, m, M), products of others' `columns` (R N, m) with these over the rows of each part's estimate,
        without what the fitted parameters explain.

        Of columns orthogonal to the parameters in all rows a fold's estimate has those of all rows, less those of its
        own rows as they are with these as the estimate predicts them (Sherman-Morrison-Woodbury)."""
        whole = columns.T @ self.columns
        return np.stack([whole - columns[part.absent].T @ self.held_out[part.absent] for part in parts])

    def residual_rows(self, part: FoldSplit) -> Array:
        """(T, M), the rows that a part predicts, without what its estimate of the fitted parameters explains."""
        return self.columns if part.absent == NO_ROWS else self.held_out[part.predicted_rows]

    def predicted(self, part: FoldSplit, amounts: Array, theta: Array) -> Array:
        """(T, S), what each set says of the rows that a part predicts. amounts: (p, M), theta: (M,)."""
        columns = self.residual_rows(part)
        along, found = np.empty((len(amounts), len(self))), np.empty((len(columns), len(self)), order="F")
        for stack in self.stacks:
            own = theta[stack.columns].reshape(-1, stack.size)
            for rows, out in ((columns, found), (amounts, along)):
                sets = rows[:, stack.columns].reshape(len(rows), *own.shape)
                np.einsum("rnm,nm->rn", sets, own, out=out[:, stack.places])
        found -= part.predictor @ along
        return found

    def with_explained(self, rows: Array, of_residual: Array) -> ColumnSets:
        """The sets with their amounts (parts, k, M) along further directions explained too; `of_residual` (parts, k):
        the residual's."""
        less = []
        for stack, gram in zip(self.stacks, self.grams, strict=True):
            taken = by_set(rows, stack)
            less.append(gram - np.swapaxes(taken, -1, -2) @ taken)
        along = self.along - (of_residual[:, None, :] @ rows)[:, 0]
        explained = np.concatenate([self.explained, rows], axis=1)
        return replace(self, explained=explained, along=along, grams=tuple(less))


def by_set(rows: Array, stack: EqualSizedSets) -> Array:
    """(..., n, r, m), columns (..., r, M) of a stack's sets."""
    own = rows[..., stack.columns]
    return np.moveaxis(own.reshape(*own.shape[:-1], len(stack.numbers), stack.size), -2, -3)


def stacks_of(sizes: Sequence[int]) -> tuple[EqualSizedSets, ...]:
    """Sets of these sizes, those of one size together, the smallest first."""
    found, start, place = [], 0, 0
    for size in sorted(set(sizes)):
        numbers = np.flatnonzero(np.array(sizes) == size)
        found.append(EqualSizedSets(numbers, start, place, size))
        start, place = start + len(numbers) * size, place + len(numbers)
    return tuple(found)


def columns_of(stacks: Sequence[EqualSizedSets]) -> dict[int, slice]:
    """Places of the columns of each set, by its number."""
    return {
        int(number): slice(stack.start + i * stack.size, stack.start + (i + 1) * stack.size)
        for stack in stacks
        for i, number in enumerate(stack.numbers)
    }


def side_by_side(sets: Sequence[Array], rows: int) -> tuple[Array, tuple[EqualSizedSets, ...]]:
    """(rows, M), sets of columns (rows, m) that stand by size, and where each stands."""
    stacks = stacks_of([one.shape[1] for one in sets])
    order = [int(number) for stack in stacks for number in stack.numbers]
    return np.concatenate([np.empty((0, rows)), *(sets[number].T for number in order)]).T, stacks


def column_sets(
    columns: Array, residual: Array, stacks: tuple[EqualSizedSets, ...], parts: Sequence[FoldSplit]
) -> ColumnSets:
    """Sets of columns (R N, M) that, as the residual (R N,), are orthogonal to the fitted parameters."""
    held_out = np.empty_like(columns)
    for part in parts[1:]:
        own = columns[part.predicted_rows]
        held_out[part.predicted_rows] = own + np.linalg.multi_dot([part.fitted, part.fitted.T, own])
    along = np.tile(residual @ columns, (len(parts), 1))
    for row, part in zip(along, parts, strict=True):
        row -= residual[part.absent] @ held_out[part.absent]
    none = np.empty((len(parts), 0, columns.shape[1]))
    return _with_grams(columns, held_out, none, along, stacks, parts)


def united(sets: Sequence[ColumnSets], parts: Sequence[FoldSplit]) -> ColumnSets:
    """All columns of some sets of the same fit, in this order, as one set."""
    columns, held_out = np.concatenate([[one.columns.T, one.held_out.T] for one in sets], axis=1).transpose(0, 2, 1)
    explained = np.concatenate([one.explained for one in sets], axis=2)
    along = np.concatenate([one.along for one in sets], axis=1)
    return _with_grams(columns, held_out, explained, along, stacks_of([columns.shape[1]]), parts)


def _with_grams(
    columns: Array,
    held_out: Array,
    explained: Array,
    along: Array,
    stacks: tuple[EqualSizedSets, ...],
    parts: Sequence[FoldSplit],
) -> ColumnSets:
    grams = []
    for stack in stacks:
        every, known = by_set(columns, stack), by_set(explained, stack)
        found = np.swapaxes(every, -1, -2) @ every - np.swapaxes(known, -1, -2) @ known
        for part, out in zip(parts, found, strict=True):
            own, left = by_set(columns[part.absent], stack), by_set(held_out[part.absent], stack)
            out -= np.swapaxes(own, -1, -2) @ left
        grams.append(found)
    return ColumnSets(columns, held_out, explained, stacks, along, tuple(grams))
