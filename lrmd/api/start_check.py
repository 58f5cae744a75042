"""Check of a configuration without starting anything: it loads what the start loads."""

from __future__ import annotations

import zenoh

from lrm_math.errors import LrmError
from lrmd.api.deployed_motion import predictor_of
from lrmd.api.model_trial import load_checked
from lrmd.config import Config
from lrmd.messages.zenoh_session import client, in_one_line, own_endpoints, router
from lrmd.persistence.deployed_models import DeployedVersions, ModelKind


def check_start(config: Config) -> str:
    """Loads the model, its solver and its guard, and both zenoh configurations; returns what was loaded, in one line.

    Raises `LrmError` for what the start would refuse. The state file is not read: no content of it stops a start.
    """
    poses, moves = (DeployedVersions.of(config, kind) for kind in (ModelKind.POSES, ModelKind.MOTION))
    with poses.undo_named():
        deployed, guard = load_checked(config, poses.in_use)
    with moves.undo_named():
        predictor = predictor_of(config, moves.in_use)
    try:
        router(config.zenoh)
        client(own_endpoints(config.zenoh), config.zenoh.config)
    except zenoh.ZError as error:
        raise LrmError(f"zenoh: {in_one_line(error)}") from None
    motion = "" if predictor is None else f"; motion model {predictor.path}, {config.motion.shaping}"
    model = f"model {deployed.path}" + (f" ({deployed.sha256[:12]})" if deployed.sha256 else "")
    shapes = "" if guard else "; no collision shapes: no move is checked"
    return f"{config.robot}, {config.arm.name}, servos {', '.join(config.names)}; {model}{shapes}{motion}"
