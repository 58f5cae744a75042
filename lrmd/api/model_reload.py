"""Loading, reloading and deploying of the model: tried in a process of its own, then adopted by api and ik process."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from lrm_math.arrays import Vector3
from lrm_math.model.deployed_model import under_gravity
from lrmd.api.model_trial import check_in_trial, load_checked
from lrmd.config import Config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel
from lrmd.ik.tip_movement import check_movement, tip_movement
from lrmd.persistence.deployed_models import DeployedVersions, ModelKind
from lrmd.ramp.shared_memory import GravityRecord, SharedRecords
from lrmd.safety.collision_guard import CollisionGuard, Guard
from lrmd.safety.stability import stability_of

IK_TIMEOUT, POLL_INTERVAL = 5.0, 0.005
"""s: time of the ik process for its present query and the new model, and how often its digest is read."""


class ActiveModel:
    """The model in use, in the api process, under the direction of gravity in use (m/s²).

    `guard`: with the sag of this model; None for an arm without shapes.
    """

    def __init__(self, config: Config, shared: SharedRecords) -> None:
        """Raises `LrmError` for a file that cannot be used."""
        self._config, self._shared = config, shared
        self._versions = DeployedVersions.of(config, ModelKind.POSES)
        self._lock = threading.Lock()
        self._using = threading.Lock()
        self._down: Vector3 | None = None
        self.guard: Guard | None = None
        self.gravity = config.arm.gravity
        with self._versions.undo_named():
            self.deployed = self._take(*load_checked(config, self._versions.in_use))

    def load(self) -> DeployedModel:
        """Reads the file; raises `LrmError` and keeps the present model if it cannot be used.

        The ik process sees the new digest after its present query, and loads the file itself.
        """
        with self.one_at_a_time():
            return self._take(*self._tried(self._versions.in_use))

    def deploy(self, text: str, accept: bool = False) -> DeployedModel:
        """Keeps a model file's text as a new version and uses it. Raises `LrmError`; then nothing has changed.

        `accept`: also if the tip moves by much against the model in use.
        """
        with self.one_at_a_time():
            with self._versions.new(text) as path:
                checked = self._tried(path)
                moved = tip_movement(self.deployed.model, checked[0].model, self._config.arm)
                check_movement(moved, self._config.arm, accept)
            return replace(self._take(*checked), moved=moved)

    def undo(self) -> DeployedModel:
        """Goes back to the version before. Raises `LrmError`: nothing was deployed, or that one cannot be used."""
        with self.one_at_a_time():
            with self._versions.undone() as before:
                checked = self._tried(before)
            return self._take(*checked)

    @contextmanager
    def one_at_a_time(self) -> Iterator[None]:
        """Raises `RequestError` while another model is being loaded."""
        if not self._lock.acquire(blocking=False):
            raise RequestError("busy", "another model is being checked; ask again", retryable=True)
        try:
            yield
        finally:
            self._lock.release()

    def _tried(self, path: Path | None) -> tuple[DeployedModel, Guard | None]:
        """The model of a file that passed its trial. Raises `LrmError`."""
        check_in_trial(self._config, path)
        return load_checked(self._config, path)

    def _take(self, deployed: DeployedModel, guard: Guard | None) -> DeployedModel:
        with self._using:
            self.guard, self.deployed = guard, deployed
            self._follow_gravity()
        self._shared.values.model = deployed.digest
        return deployed

    def under_gravity(self, down: Vector3 | None) -> None:
        """Uses the model under a known direction of gravity, a unit vector; None: the one that the model says."""
        with self._using:
            self._down = down
            self._follow_gravity()
        self._shared.write_gravity(GravityRecord() if down is None else GravityRecord(True, *down))

    def _follow_gravity(self) -> None:
        model = self.deployed.model
        here = model if self._down is None else under_gravity(model, self._down)
        self.gravity = here.constant_gravity
        if isinstance(self.guard, CollisionGuard):
            bending = None if self.guard.model is None else here
            self.guard = replace(self.guard, model=bending, stability=stability_of(self._config, here))

    def wait_for_ik(self, deployed: DeployedModel) -> None:
        """Waits until the ik process answers with this model. Raises `RequestError`."""
        deadline = time.monotonic() + IK_TIMEOUT
        while self._shared.values.ik_model != deployed.digest:
            if time.monotonic() > deadline:
                text = f"loaded and checked, but after {IK_TIMEOUT:g} s the ik process does not answer with it yet"
                raise RequestError("ik_silent", text, retryable=True)
            time.sleep(POLL_INTERVAL)
