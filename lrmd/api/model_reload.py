"""The model that the daemon accepted: checked before anybody works with it, and the same one in every process."""

from __future__ import annotations

import threading
import time

from lrmd.config import Config
from lrmd.errors import Refused
from lrmd.ik.service import solver_of
from lrmd.ramp.shared_memory import Shared
from lrmd.safety.collision_guard import Guard, guard_of
from lrmd.safety.deployed_model import Deployed, deploy

PATIENCE = 5.0
"""s: how long the ik process may take over its last query and the new model."""
LOOK_EVERY = 0.005


class ModelInUse:
    """The api process's side. `guard`: of the arm as this model has it sag; None for an arm without shapes."""

    def __init__(self, config: Config, shared: Shared) -> None:
        """Raises `LrmError` for a file that cannot be used."""
        self._config, self._shared = config, shared
        self._lock = threading.Lock()
        self.guard: Guard | None = None
        self.load()

    def load(self) -> Deployed:
        """Takes the file as it is now; raises `LrmError` and keeps what it has if that cannot be used.

        The ik process sees the digest and follows by itself, when it has answered what it is at.
        """
        with self._lock:
            deployed = deploy(self._config)
            solver_of(self._config, deployed)
            self.guard = guard_of(self._config.arm, deployed.model if deployed.sha256 else None)
            self._shared.model = deployed.digest
            return deployed

    def wait_for_ik(self, deployed: Deployed) -> None:
        """Waits until queries are answered with this model. Raises `Refused`."""
        end = time.monotonic() + PATIENCE
        while self._shared.ik_model != deployed.digest:
            if time.monotonic() > end:
                text = f"loaded and checked, but after {PATIENCE:g} s the ik process does not answer with it yet"
                raise Refused("ik_silent", text, retryable=True)
            time.sleep(LOOK_EVERY)
