"""One kind of what is measured of poses: its numbers and their noise, where it is read, and how a model predicts it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_ident.data.measurement_file.conventions import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurement_file.pose_quantity import PoseQuantity, StatedQuantity
from lrm_ident.data.source import Source
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model
from lrm_math.model.sensed import Measurand


@dataclass(frozen=True, eq=False)
class Observation(ABC):
    """What instruments of one kind measured of N poses: k numbers of each. Every array has a row for each pose.

    Attributes:
        values: (N, ...), what was measured (SI), NaN where nothing was.
        sd: (N,), standard deviation of each of a pose's numbers (SI), where they are alike and alone; or None.
        blocks: (N, k, k), their covariance (SI), where it is stated; or None.
        cross: (N, k, 3), their covariance with the errors of the positions (SI); 0: independent.
        words: its name. needs: what states its noise. is_length: whether its numbers are in metres.
        quantities: its columns in files, beside those of single joints.
    """

    values: Array
    sd: Array | None = None
    blocks: Array | None = None
    cross: Array | float = 0.0
    words: ClassVar[str]
    needs: ClassVar[str]
    is_length: ClassVar[bool] = False
    quantities: ClassVar[tuple[PoseQuantity, ...]] = ()

    @classmethod
    @abstractmethod
    def read(cls, table: NumberTable, beside: Metadata) -> Iterator[Self]:
        """What a file states of it, if it does. Raises `FileError`."""

    @abstractmethod
    def columns(self) -> Iterator[StatedQuantity]:
        """What files state of it."""

    @property
    @abstractmethod
    def measurand(self) -> Measurand:
        """The quantity that is measured."""

    @abstractmethod
    def residual(self, settled: Equilibrium) -> Array:
        """(N, k), what was measured less what the model predicts (SI); NaN where nothing was measured."""

    @property
    def numbers(self) -> Array:
        """(N, k), NaN where one was not measured."""
        return self.values.reshape(len(self.values), -1)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(N,), whether any number of a pose was measured."""
        return np.asarray(~np.isnan(self.numbers).all(axis=1))

    @property
    def rows(self) -> NDArray[np.int64]:
        """Poses of which something was measured."""
        return np.flatnonzero(self.measured)

    @property
    def covariance(self) -> Array:
        """(N, k, k), of its numbers (SI), one where it is not stated; NaN where one was not measured."""
        gone = np.isnan(self.numbers)
        alone = np.eye(gone.shape[1]) * (1.0 if self.sd is None else self.sd[:, None, None] ** 2)
        return np.where(gone[:, :, None] | gone[:, None, :], np.nan, alone if self.blocks is None else self.blocks)

    @property
    def rms_sd(self) -> Array | None:
        """(N,), RMS of the standard deviations of its numbers (SI); None where they are not stated."""
        return self.sd if self.blocks is None else np.sqrt(np.einsum("nkk->n", self.blocks) / self.blocks.shape[1])

    @property
    def states_noise(self) -> bool:
        """Whether its noise is stated."""
        weighed = self.weighed()
        return weighed.sd is not None or weighed.blocks is not None

    def weighed(self) -> Self:
        """The same with the noise of every single number, as far as it is known."""
        return self

    def doubts(self, arm: Arm) -> Iterator[str]:
        """What a person should know of it, in words."""
        yield from ()

    def set_up(self, model: Model, poses: Poses, source: Source) -> Model:
        """The model, knowing what these data need of the measuring set-up. Raises `FileError`."""
        return model

    def shift(self, settled: Equilibrium) -> Array:
        """(N, 3), by which the TCP was measured beside its prediction (m), as far as this shows it, else NaN."""
        return np.full((len(self.values), 3), np.nan)

    def turn(self, settled: Equilibrium) -> Array:
        """(N, 3), rotation vectors by which the tool was (rad), as far as this shows it, else NaN."""
        return np.full((len(self.values), 3), np.nan)

    def turned(self, rotation: Array, translation: Array) -> Self:
        """Where positions p become R p + t, with rotation R (3, 3) and translation t (3,), m."""
        return self

    def take(self, rows: ArrayLike) -> Self:
        """Some poses (indices or a mask)."""
        chosen, parts = np.asarray(rows), {field.name: getattr(self, field.name) for field in fields(self)}
        return replace(self, **{name: part[chosen] for name, part in parts.items() if isinstance(part, np.ndarray)})
