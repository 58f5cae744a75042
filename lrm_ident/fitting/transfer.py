"""Transfer of a calibrated arm to another installation (Conenna 2024, chapter 7: from the rig to the rover).

What is true of the arm goes along as a prior, with its covariance: the posterior of the first measurements is the
prior of the next ones (Bayes). The bench's installation and measurement stay behind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.fitting.parameter_sets import fittable
from lrm_ident.fitting.priors import WEAK_SD, Prior
from lrm_math.arm.arm import BASE, TOOL, Arm
from lrm_math.arm.arm_part import arm_part_difference
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, Effect, ModelPart
from lrm_math.errors import LrmError
from lrm_math.model.covariance import Covariance
from lrm_math.model.deployed_model import as_deployed, named_part
from lrm_math.model.model import Model, model_of

NAME = "arm as identified before"
INSTALLED = {"offsets": (BASE, TOOL), "compliance": (BASE,), "gravity": (BASE,)}
"""Effects, and their places, by which one installation of an arm differs from its drawing."""
LEAST_EIGENVALUE = 1e-6
"""Of a correlation matrix that was rounded in a file."""


@dataclass(frozen=True, eq=False)
class TransferredModel:
    """Model of an arm in another installation, before anything was measured there.

    Attributes:
        model: its free parameters are those of the prior.
        covariance: of the arm's parameters, as identified on the bench; of the installation's, typical sizes.
        noise: error that the model left on the bench, standard deviation per axis (m).
        bench: name of the arm as it was mounted there.
        installed: keys of the installation's parameters.
        left_behind: names of the effects of the bench and its measurement that do not go along.
        state: words for the state of its session effects that goes along; empty where there is none.
    """

    model: Model
    covariance: Covariance
    noise: float
    bench: str
    installed: tuple[str, ...]
    left_behind: tuple[str, ...]
    state: str = ""

    @property
    def prior(self) -> Prior:
        """Prior of a fit: of the installation three typical sizes wide, so that it hardly pulls what few poses tell."""
        keys, covariance = self.covariance
        wide = np.array([WEAK_SD if key in self.installed else 1.0 for key in keys])
        mean = np.array([self.model.value(key) for key in keys])
        return Prior(NAME, keys, mean, covariance * np.outer(wide, wide), noise=self.noise, within=self.model.within)

    @property
    def measured_arm(self) -> Arm:
        """The arm with the joint limits within which the model was identified: its curves are not known beyond them."""
        arm, within = self.model.arm, self.model.within
        if within is None:
            return arm
        ends = zip(arm.joints, within.angle, strict=True)
        narrow = [replace(j, lower=max(j.lower, low), upper=min(j.upper, high)) for j, (low, high) in ends]
        possible = all(joint.lower < joint.upper for joint in narrow)
        return replace(arm, joints=tuple(narrow)) if possible else arm

    def informed(self, jacobian: Array) -> Covariance:
        """Covariance of a fit to poses with a Jacobian (N, 3, P), where the installation is as wrong as is typical.

        Of the estimate x + K (y − J x), K the gain of the prior: (1 − K J) C (1 − K J)ᵀ + σ² K Kᵀ.
        """
        prior, J = self.prior.covariance, jacobian.reshape(-1, len(self.covariance.keys))
        K = np.linalg.solve(J @ prior @ J.T + self.noise**2 * np.eye(len(J)), J @ prior).T
        kept = np.eye(len(prior)) - K @ J
        after = kept @ self.covariance.matrix @ kept.T + self.noise**2 * K @ K.T
        return Covariance(self.covariance.keys, np.asarray(after))


def transferred(model: Model, covariance: Covariance | None, arm: Arm, noise: float) -> TransferredModel:
    """The arm's part of a model, on another installation of that arm.

    Args:
        covariance: of the model's parameters; those without one are taken as exact.
        arm: the target; only its base, gravity, tool and limits may differ.
        noise: error that the model left on the bench, standard deviation per axis (m).

    Raises `LrmError`: links, servos or masses differ.
    """
    if words := arm_part_difference(model.arm, arm):
        raise LrmError(f"not the same arm: {words}; only base, tool, gravity and joint limits may differ")
    lasting = named_part(as_deployed(model))
    arm_effects = [replace(effect, arm=arm) for effect in lasting.effects if effect.part is ModelPart.ARM]
    there = model_of(arm, arm_effects, _values(lasting, arm_effects))
    installation = installed_effects(arm, lasting.effects)
    target = model_of(arm, (*arm_effects, *installation), _values(there, arm_effects))
    free = fittable(model_of(arm, installation))
    certain = Covariance((), np.empty((0, 0))) if covariance is None else covariance.marginal(model, there)
    covariance = _covariance(target, certain, free)
    within = None if lasting.within is None else replace(lasting.within, tcp=None, centre=None)
    moved = replace(target, within=within, fitted_to=model.fitted_to, free=covariance.keys)
    names = {effect.name for effect in arm_effects}
    said = "" if model.state is None else model.state.sentence
    behind = tuple(effect.name for effect in model.effects if effect.name not in names)
    return TransferredModel(moved, covariance, noise, model.arm.name, free, behind, said)


def installed_effects(arm: Arm, also: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """Effects of the installation of an arm: base, tool and gravity, and the laws of a bench, all at zero.

    A free form of a bench (a curve) is not among them: few poses cannot tell another.
    """
    every = {kind.id: kind for kind in CATALOGUE}
    usual = [every[name](arm, place) for name, places in INSTALLED.items() for place in places]
    names = {effect.name for effect in usual}
    laws = [effect for effect in also if effect.part is ModelPart.INSTALLATION and not effect.is_free_form]
    more = [replace(effect, arm=arm) for effect in laws if effect.name not in names]
    return (*usual, *(effect for effect in more if effect.place in type(effect).places(arm)))


def _values(model: Model, effects: Sequence[Effect]) -> Mapping[str, float]:
    return {key: model.value(key) for effect in effects for key in effect.keys}


def _covariance(target: Model, certain: Covariance, installed: Sequence[str]) -> Covariance:
    """Covariance of the arm's parameters that have a variance, and of the installation's: typical sizes."""
    rows = [k for k, variance in enumerate(np.diag(certain.matrix)) if variance > 0.0]
    size, keys = len(rows), (*(certain.keys[k] for k in rows), *installed)
    covariance = np.diag(np.array([target.parameter(key).typical for key in keys]) ** 2)
    covariance[:size, :size] = _regular(certain.matrix[np.ix_(rows, rows)])
    return Covariance(keys, covariance)


def _regular(covariance: Array) -> Array:
    """A covariance (P, P) whose correlations have no eigenvalue that rounding made zero or negative."""
    error = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(error, error))
    regular = (vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T
    return np.asarray(regular * np.outer(error, error))
