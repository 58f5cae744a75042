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


@dataclass(frozen=True, eq=False)
class FoldSplit:
    """Rows that parameters are estimated from, and rows that the estimate is for: of a fold, or all from all.

    Attributes:
        poses: those that are predicted.
        absent: rows left out of the estimate.
        predicted_rows: T rows that are predicted.
        predictor: (T, p), what the amounts along p orthonormal directions of the estimate's rows predict.
    """

    poses: NDArray[np.int64]
    absent: slice
    predicted_rows: slice
    predictor: Array


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
        explained: for each part (p, M), their amounts along its orthonormal directions.
        stacks: the sets by size, in the order of their columns.
        grams: for each stack (parts, n, m, m), products of each set's columns over the rows of the estimate, without
            what is explained.
    """

    columns: Array
    explained: tuple[Array, ...]
    stacks: tuple[EqualSizedSets, ...]
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
            explained = tuple(part[:, own] for part in self.explained)
            yield ColumnSets(self.columns[:, own], explained, (alone,), (grams[stack][:, [i]],))

    def copy(self) -> ColumnSets:
        """Arrays of their own: what the sets were taken from can be forgotten."""
        explained = tuple(part.copy() for part in self.explained)
        return ColumnSets(self.columns.copy(), explained, self.stacks, self.grams)

    @property
    def starts(self) -> NDArray[np.int64]:
        """(S,), first column of each set, in the order of the columns."""
        return np.concatenate([stack.start + stack.size * np.arange(len(stack.numbers)) for stack in self.stacks])

    @property
    def numbers(self) -> NDArray[np.int64]:
        """(S,), number of each set, in the order of the columns."""
        return np.concatenate([stack.numbers for stack in self.stacks])

    def products(self, parts: Sequence[FoldSplit], other: ColumnSets) -> list[Array]:
        """Products for each part (m, M) of the columns of the other, a single set, with these over the rows of the
        estimate, without what is explained of both."""
        absent = [other.columns[part.absent].T @ self.columns[part.absent] for part in parts]
        whole = sum(absent)
        return [
            whole - own - theirs.T @ amounts
            for own, theirs, amounts in zip(absent, other.explained, self.explained, strict=True)
        ]

    def predicted(self, part: FoldSplit, amounts: Array, theta: Array) -> Array:
        """(T, S), what each set says of the rows that a part predicts. amounts: (p, M), theta: (M,)."""
        columns = self.columns[part.predicted_rows]
        along, found = np.empty((len(amounts), len(self))), np.empty((len(columns), len(self)))
        for stack in self.stacks:
            own = theta[stack.columns].reshape(-1, stack.size)
            for rows, out in ((columns, found), (amounts, along)):
                sets = rows[:, stack.columns].reshape(len(rows), *own.shape)
                np.einsum("rnm,nm->rn", sets, own, out=out[:, stack.places])
        found -= part.predictor @ along
        return found

    def with_explained(self, rows: Sequence[Array]) -> ColumnSets:
        """The sets with their amounts (k, M) along further directions of each part explained too."""
        less = []
        for stack, gram in zip(self.stacks, self.grams, strict=True):
            taken = np.stack([by_set(part, stack) for part in rows])
            less.append(gram - taken.transpose(0, 1, 3, 2) @ taken)
        explained = tuple(np.concatenate(both) for both in zip(self.explained, rows, strict=True))
        return replace(self, explained=explained, grams=tuple(less))


def by_set(rows: Array, stack: EqualSizedSets) -> Array:
    """(n, rows, m), columns of a stack's sets."""
    own = rows[:, stack.columns]
    return own.reshape(len(own), len(stack.numbers), stack.size).transpose(1, 0, 2)


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


def column_sets(
    columns: Array, explained: tuple[Array, ...], stacks: tuple[EqualSizedSets, ...], parts: Sequence[FoldSplit]
) -> ColumnSets:
    """Sets whose columns and explained amounts are known."""
    grams = []
    for stack in stacks:
        absent, known = np.empty((2, len(parts), len(stack.numbers), stack.size, stack.size))
        for number, (part, amounts) in enumerate(zip(parts, explained, strict=True)):
            for rows, out in ((columns[part.absent], absent), (amounts, known)):
                alone = by_set(rows, stack)
                np.matmul(alone.transpose(0, 2, 1), alone, out=out[number])
        grams.append(absent.sum(axis=0) - absent - known)
    return ColumnSets(columns, explained, stacks, tuple(grams))


def joined(sets: Sequence[ColumnSets], parts: Sequence[FoldSplit], together: bool = False) -> ColumnSets:
    """Sets of the same fit side by side, in this order; `together`: as one set."""
    sizes = [one.columns.shape[1] for one in sets]
    order = range(len(sets)) if together else [int(i) for stack in stacks_of(sizes) for i in stack.numbers]
    columns = np.concatenate([sets[i].columns for i in order], axis=1)
    explained = tuple(
        np.concatenate([sets[i].explained[number] for i in order], axis=1) for number in range(len(parts))
    )
    return column_sets(columns, explained, stacks_of([sum(sizes)] if together else sizes), parts)
