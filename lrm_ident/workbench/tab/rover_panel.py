"""The panel of a running daemon: where its arm is, and where the model of the session thinks the tip is."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from nicegui import ui

from lrm_ident.workbench.session import WorkbenchSession
from lrm_math.errors import LrmError

if TYPE_CHECKING:
    from lrm_ident.workbench.tab.rover_link import RoverLink
    from lrm_math.model.model import Model


class RoverPanel:
    """Panel of one tab. What it needs is loaded when somebody listens, since the page would wait for it."""

    def __init__(self, session: WorkbenchSession) -> None:
        self.session = session
        self.link: RoverLink | None = None

    def listen(self, robot: str, endpoint: str) -> None:
        """Begins to listen to a daemon, for as long as the tab is open."""
        from lrm_ident.workbench.tab.rover_link import RoverLink

        self.hang_up()
        self.link = RoverLink.to(robot, endpoint)
        self.link.start()
        ui.context.client.on_disconnect(self.hang_up)

    def hang_up(self) -> None:
        """Ends it."""
        if self.link is not None:
            self.link.close()
            self.link = None
            ui.run_javascript("lrm.rover(null)")

    def show(self) -> None:
        """Shows where the arm is now, or why that is not known."""
        step = self.session.step
        if self.link is None or step is None:
            return
        try:
            values = self.link.position(_model(step.files.model, step.files.effects_file))
        except LrmError as error:
            values = {"words": str(error)}
        ui.run_javascript(f"lrm.rover({json.dumps(values)})")


@lru_cache(maxsize=1)
def _model(file: Path, effects_file: Path | None) -> Model:
    """The model of a step, whose file is never written again. Raises `LrmError`."""
    from lrm_ident.fitting.effect_plugins import catalogue_with
    from lrm_math.model.model_file import load_model

    return load_model(file, catalogue_with(effects_file))
