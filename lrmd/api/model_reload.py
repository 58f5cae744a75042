"""Loading and reloading of the model: checked in the api process, then adopted by the ik process."""

from __future__ import annotations

import threading
import time

from lrm_math.errors import FileError, LrmError
from lrmd.config import Config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel, deploy
from lrmd.ik.service import solver_of
from lrmd.ramp.shared_memory import SharedRecords
from lrmd.safety.collision_guard import Guard, guard_of
from lrmd.safety.model_check import check_comes_to_rest

IK_TIMEOUT, POLL_INTERVAL = 5.0, 0.005
"""s: time of the ik process for its present query and the new model, and how often its digest is read."""


def load_checked(config: Config) -> tuple[DeployedModel, Guard | None]:
    """The configured model, and the guard with its sag. Raises `LrmError` for a file that cannot be used."""
    deployed = deploy(config)
    solver_of(config, deployed)
    try:
        check_comes_to_rest(config.arm, deployed.model)
    except LrmError as error:
        raise FileError(deployed.path, "", str(error)) from None
    return deployed, guard_of(config.arm, deployed.model if deployed.sha256 else None)


class ActiveModel:
    """The model in use, in the api process. `guard`: with the sag of this model; None for an arm without shapes."""

    def __init__(self, config: Config, shared: SharedRecords) -> None:
        """Raises `LrmError` for a file that cannot be used."""
        self._config, self._shared = config, shared
        self._lock = threading.Lock()
        self.guard: Guard | None = None
        self.load()

    def load(self) -> DeployedModel:
        """Reads the file; raises `LrmError` and keeps the present model if it cannot be used.

        The ik process sees the new digest after its present query, and loads the file itself.
        """
        with self._lock:
            deployed, self.guard = load_checked(self._config)
            self._shared.model = deployed.digest
            return deployed

    def wait_for_ik(self, deployed: DeployedModel) -> None:
        """Waits until the ik process answers with this model. Raises `RequestError`."""
        deadline = time.monotonic() + IK_TIMEOUT
        while self._shared.ik_model != deployed.digest:
            if time.monotonic() > deadline:
                text = f"loaded and checked, but after {IK_TIMEOUT:g} s the ik process does not answer with it yet"
                raise RequestError("ik_silent", text, retryable=True)
            time.sleep(POLL_INTERVAL)
