"""Sets of columns (one set for each candidate) with their normal equations, in the sample and in every fold.

Every set is tried alone, so only products of columns within a set are kept. Sets of equal size stand together, so that
their normal equations are solved in one call; rows stand fold by fold, so that those of a fold are a slice.
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
    """Training rows and predicted rows of a fold, or of the whole sample, where all rows are both.

    Attributes:
        poses: poses that are predicted.
        absent: rows that are no training rows.
        predicted_rows: T rows that are predicted.
        fitted: (T, P), prediction for unit amounts along orthonormal directions of the fitted parameters.
        predictor: (T, p), prediction for unit amounts along p directions of columns that were selected later.
        residual: (T,), at the predicted rows.
    """

    poses: NDArray[np.int64]
    absent: slice
    predicted_rows: slice
    fitted: Array
    predictor: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class EqualSizedSets:
    """Sets of equal `size`: their `numbers` (n,), the first of their columns (`start`), and the position of the first
    set in the order of columns (`place`)."""

    numbers: NDArray[np.int64]
    start: int
    place: int
    size: int

    @property
    def places(self) -> slice:
        """Positions of the sets in the order of columns."""
        return slice(self.place, self.place + len(self.numbers))

    @property
    def columns(self) -> slice:
        """Columns of the sets."""
        return slice(self.start, self.start + len(self.numbers) * self.size)


@dataclass(frozen=True, eq=False)
class ColumnSets:
    """S sets of M columns in all, the columns of a fit projected out.

    Attributes:
        columns: (R N, M), fold by fold; the fitted parameters' columns are projected out over all rows.
        held_out: (R N, M), the same, where each fold is projected by an estimate from the other folds.
        explained: (parts, p, M), amounts of the columns along the directions of columns that were selected later.
        stacks: the sets by size, in the order of their columns.
        along: (parts, M), right sides of the normal equations: products with the residual over the training rows, what
            is fitted and selected projected out of both.
        grams: for each stack (parts, n, m, m), matrices of the normal equations: such products within each set.
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
        grams: dict[int, Array] = {}
        for stack, gram in zip(self.stacks, self.grams, strict=True):
            grams |= {int(number): gram[:, i : i + 1] for i, number in enumerate(stack.numbers)}
        for number, set_columns in sorted(columns_of(self.stacks).items(), key=lambda item: item[0]):
            rows = self.columns[:, set_columns], self.held_out[:, set_columns], self.explained[:, :, set_columns]
            alone = stacks_of([set_columns.stop - set_columns.start])
            yield ColumnSets(*rows, alone, self.along[:, set_columns], (grams[number],))

    @property
    def starts(self) -> NDArray[np.int64]:
        """(S,), first column of each set, in the order of the columns."""
        each = (stack.start + stack.size * np.arange(len(stack.numbers)) for stack in self.stacks)
        return np.concatenate([np.empty(0, dtype=np.int64), *each])

    @property
    def numbers(self) -> NDArray[np.int64]:
        """(S,), number of each set, in the order of the columns."""
        return np.concatenate([np.empty(0, dtype=np.int64), *(stack.numbers for stack in self.stacks)])

    def products(self, parts: Sequence[FoldSplit], columns: Array) -> Array:
        """(parts, m, M), products of other `columns` (R N, m) with these over the training rows of each part, fitted
        parameters projected out.

        As columns are orthogonal to the parameters' over all rows, the products of a fold's training rows are those of
        all rows less those of its own rows, one factor of which is the `held_out` one (Sherman–Morrison–Woodbury).
        """
        whole = columns.T @ self.columns
        return np.stack([whole - columns[part.absent].T @ self.held_out[part.absent] for part in parts])

    def residual_rows(self, part: FoldSplit) -> Array:
        """(T, M), columns at the predicted rows of a part, projected by its own estimate of the fitted parameters."""
        return self.columns if part.absent == NO_ROWS else self.held_out[part.predicted_rows]

    def predicted(self, part: FoldSplit, amounts: Array, theta: Array) -> Array:
        """(T, S), prediction of each set at the predicted rows of a part, from its amounts (p, M) and θ (M,)."""
        columns = self.residual_rows(part)
        along, prediction = np.empty((len(amounts), len(self))), np.empty((len(columns), len(self)), order="F")
        for stack in self.stacks:
            amounts_of_set = theta[stack.columns].reshape(-1, stack.size)
            for rows, out in ((columns, prediction), (amounts, along)):
                sets = rows[:, stack.columns].reshape(len(rows), *amounts_of_set.shape)
                np.einsum("rnm,nm->rn", sets, amounts_of_set, out=out[:, stack.places])
        prediction -= part.predictor @ along
        return prediction

    def with_explained(self, rows: Array, of_residual: Array) -> ColumnSets:
        """The sets with k further directions projected out.

        Args:
            rows: (parts, k, M), amounts of the columns along them. of_residual: (parts, k), of the residual.
        """
        less = []
        for stack, gram in zip(self.stacks, self.grams, strict=True):
            taken = by_set(rows, stack)
            less.append(gram - np.swapaxes(taken, -1, -2) @ taken)
        along = self.along - (of_residual[:, None, :] @ rows)[:, 0]
        explained = np.concatenate([self.explained, rows], axis=1)
        return replace(self, explained=explained, along=along, grams=tuple(less))


def by_set(rows: Array, stack: EqualSizedSets) -> Array:
    """(..., n, r, m), columns (..., r, M) of a stack's sets."""
    columns = rows[..., stack.columns]
    return np.moveaxis(columns.reshape(*columns.shape[:-1], len(stack.numbers), stack.size), -2, -3)


def stacks_of(sizes: Sequence[int]) -> tuple[EqualSizedSets, ...]:
    """Sets of these sizes, those of one size together, the smallest first."""
    stacks, start, place = [], 0, 0
    for size in sorted(set(sizes)):
        numbers = np.flatnonzero(np.array(sizes) == size)
        stacks.append(EqualSizedSets(numbers, start, place, size))
        start, place = start + len(numbers) * size, place + len(numbers)
    return tuple(stacks)


def columns_of(stacks: Sequence[EqualSizedSets]) -> dict[int, slice]:
    """Columns of each set, by its number."""
    return {
        int(number): slice(stack.start + i * stack.size, stack.start + (i + 1) * stack.size)
        for stack in stacks
        for i, number in enumerate(stack.numbers)
    }


def side_by_side(sets: Sequence[Array], rows: int) -> tuple[Array, tuple[EqualSizedSets, ...]]:
    """(rows, M), sets of columns (rows, m) in one array, ordered by size, and where each stands."""
    stacks = stacks_of([matrix.shape[1] for matrix in sets])
    order = [int(number) for stack in stacks for number in stack.numbers]
    return np.concatenate([np.empty((0, rows)), *(sets[number].T for number in order)]).T, stacks


def column_sets(
    columns: Array, residual: Array, stacks: tuple[EqualSizedSets, ...], parts: Sequence[FoldSplit]
) -> ColumnSets:
    """Sets of columns (R N, M); these and the residual (R N,) are orthogonal to the fitted parameters' columns."""
    held_out = np.empty_like(columns)
    for part in parts[1:]:
        predicted_columns = columns[part.predicted_rows]
        held_out[part.predicted_rows] = predicted_columns + np.linalg.multi_dot(
            [part.fitted, part.fitted.T, predicted_columns]
        )
    along = np.tile(residual @ columns, (len(parts), 1))
    for row, part in zip(along, parts, strict=True):
        row -= residual[part.absent] @ held_out[part.absent]
    none = np.empty((len(parts), 0, columns.shape[1]))
    return _with_grams(columns, held_out, none, along, stacks, parts)


def united(sets: Sequence[ColumnSets], parts: Sequence[FoldSplit]) -> ColumnSets:
    """Union of sets of one fit, as one set with the columns in this order."""
    columns, held_out = np.concatenate([[part.columns.T, part.held_out.T] for part in sets], axis=1).transpose(0, 2, 1)
    explained = np.concatenate([part.explained for part in sets], axis=2)
    along = np.concatenate([part.along for part in sets], axis=1)
    return _with_grams(columns, held_out, explained, along, stacks_of([columns.shape[1]]), parts)


def _with_grams(
    columns: Array,
    held_out: Array,
    explained: Array,
    along: Array,
    stacks: tuple[EqualSizedSets, ...],
    parts: Sequence[FoldSplit],
) -> ColumnSets:
    """Column sets with the matrices of their normal equations."""
    grams = []
    for stack in stacks:
        every, explained_sets = by_set(columns, stack), by_set(explained, stack)
        gram_of_set = np.swapaxes(every, -1, -2) @ every - np.swapaxes(explained_sets, -1, -2) @ explained_sets
        for part, out in zip(parts, gram_of_set, strict=True):
            columns_here, unexplained = by_set(columns[part.absent], stack), by_set(held_out[part.absent], stack)
            out -= np.swapaxes(columns_here, -1, -2) @ unexplained
        grams.append(gram_of_set)
    return ColumnSets(columns, held_out, explained, stacks, along, tuple(grams))
