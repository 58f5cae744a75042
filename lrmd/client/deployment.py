"""Check of a model file before it goes to the daemon: what is left out of it there, and the error to expect."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_math.arm.arm_file import arm_of
from lrm_math.arrays import Array
from lrm_math.effects.measured_range import Interval
from lrm_math.effects.reference import ParameterRef
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.history import history_of
from lrm_math.kinematics.poses import Poses
from lrm_math.model.covariance import Covariance, implausible_estimates
from lrm_math.model.deployed_model import FIT_STATE, as_deployed, as_deployed_when_read, unknown_state
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from lrm_math.model.model_file import HistoryTable, ModelFile, covariance_of, to_model
from lrm_math.model.uncertainty import expected_tip_error
from lrm_math.toml_file import read_toml

POSES = 200
NOTHING = 5e-6
"""m: less is printed as 0.00 mm."""
STEP = re.compile(r"step(\d+)")
"""Parameters of the second and later sessions."""


@dataclass(frozen=True, eq=False)
class Deployment:
    """A model as its file has it and as the daemon will use it.

    Attributes:
        state: sentences on the state of session effects that is deployed, and on terms that end with the measured
            range; empty where there are none.
        difference: RMS distance (m) between the predictions of both over the measured range and session.
        time_unknown: the same where nothing is known of before, as after pulses without a daemon: neither the time
            since power-on nor what the arm did.
        standard_error: of the predicted tip over that range (m); None: the file has no covariance.
        last: the last step of its history, with the errors that it had; None: the file has no history.
        implausible: sentences on estimates that no real arm has.
    """

    state: str
    difference: float
    time_unknown: float
    standard_error: float | None
    last: HistoryTable | None
    implausible: tuple[str, ...] = ()

    @classmethod
    def of_file(cls, path: Path) -> Deployment:
        """The deployment of a model file.

        Raises `FileError`: no valid model; or effects of a session whose state the file does not say.
        """
        file = read_toml(path, ModelFile)
        model = to_model(path, file, arm_of(path, file.arm))
        if words := unknown_state(model):
            raise FileError(path, "deployed", words, FIT_STATE)
        covariance, last = covariance_of(path, file, model), file.history[-1] if file.history else None
        reversion = None if model.within is None else model.within.reversion
        parts = (
            None if model.state is None else model.state.sentence,
            None if reversion is None else reversion.sentence,
        )
        state = " ".join(filter(None, parts))
        absurd = tuple(estimate.sentence for estimate in implausible_estimates(model, covariance))
        return cls(state, *left_out_differences(model), _standard_error(model, covariance), last, absurd)

    @property
    def refusal(self) -> str:
        """Why a person must accept this model before it is deployed; empty where nothing speaks against it.

        An estimate that is not physically plausible, or what is left out is more than the prediction's standard error.
        """
        if self.implausible:
            return self.implausible[0]
        if self.difference <= (self.standard_error or 0.0):
            return ""
        error_words = "which is not known" if self.standard_error is None else f"of {self.standard_error * 1e3:.2f} mm"
        return (
            f"without its session's effects the model predicts otherwise by {self.difference * 1e3:.2f} mm RMS, "
            f"more than its standard error {error_words}"
        )

    def check(self) -> None:
        """Raises `LrmError` where there is a `refusal`."""
        if self.refusal:
            raise LrmError(f"{self.refusal}; deploy it all the same with --accept")

    def lines(self) -> Iterator[str]:
        """Lines for a person: the state that is deployed, and the error of the tip to expect."""
        yield from self.implausible
        if self.state:
            yield self.state
        if self.difference > NOTHING:
            yield f"left out of the model: {self.difference * 1e3:.2f} mm RMS over its session"
        if self.time_unknown - self.difference > NOTHING:
            yield f"where nothing is known of before: {self.time_unknown * 1e3:.2f} mm RMS over its session"
        said = []
        if self.last is not None:
            unseen, some = "at poses not in the fit", self.last.deployed_poses
            part = unseen if some is None else f"at {some} poses not in the fit, where its state held"
            shown = {f"as deployed, {part}": self.last.deployed_rms_mm, unseen: self.last.held_out_rms_mm}
            said = [f"{rms:.2f} mm RMS {how}" for how, rms in shown.items() if rms is not None][:1]
            if self.last.deployed_95_mm is not None:
                low, high = self.last.deployed_95_mm
                said.append(f"{low:.2f} to {high:.2f} mm (95 %) while the arm stays as it is")
        if self.standard_error is not None:
            said.append(f"{self.standard_error * 1e3:.2f} mm RMS by uncertain parameters alone")
        yield f"expected at the tip: {', '.join(said) or 'not known (the file has neither history nor covariance)'}"


def left_out_differences(model: Model) -> tuple[float, float]:
    """RMS distances (m) from a model's predictions to those as it is deployed, over its measured range and session.

    Where the time since power-on is known, so that what follows it is not left out; and where it is not.
    """
    poses = _session_poses(model)
    whole = solve_equilibrium(model, poses).tcp

    def difference(deployed: Model) -> float:
        """m; zero where nothing is left out."""
        apart = 0.0 if deployed is model else whole - solve_equilibrium(deployed, poses).tcp
        return float(np.sqrt(3.0 * np.mean(np.square(apart))))

    return difference(as_deployed_when_read(model, poses)), difference(as_deployed_when_read(model))


def _standard_error(model: Model, covariance: Covariance | None) -> float | None:
    """Standard error (m) of the tip that the deployed model predicts."""
    if covariance is None:
        return None
    deployed = as_deployed(model)
    return expected_tip_error(deployed, covariance.marginal(model, deployed))


def _session_poses(model: Model) -> Poses:
    """Poses over the measured range, or the joint limits, in the order and at the times of a session like its own."""
    rng, within = np.random.default_rng(0), model.within
    ends = [(joint.lower, joint.upper) for joint in model.arm.joints] if within is None else within.angle
    lower, upper = np.array(ends).T
    t, running = (None, None) if within is None else (_evenly(within.t), _evenly(within.running))
    steps = [
        int(match[1]) for key in model.keys if model.value(key) and (match := STEP.match(ParameterRef.parse(key).name))
    ]
    session = np.ceil(np.linspace(0.0, max(steps), POSES + 1)[1:]) if steps else None
    q = rng.uniform(lower, upper, (POSES, model.arm.dof))
    number, load = np.arange(1, POSES + 1), np.zeros(POSES)
    history = None if t is None else history_of(q, load, t, session, number)
    return Poses(q, load, t=t, session=session, number=number, running=running, history=history)


def _evenly(span: Interval | None) -> Array | None:
    return None if span is None else np.linspace(*span, POSES)
