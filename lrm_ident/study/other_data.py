"""Model on data other than those of its fit: without effects of the session in which those were measured."""

from __future__ import annotations

import hashlib
from pathlib import Path

from lrm_ident.study.notices import Notice, NoticeKind
from lrm_math.kinematics.poses import Poses
from lrm_math.model.deployed_model import as_deployed, as_deployed_at, of_a_session
from lrm_math.model.model import Model


def model_for_data(
    model: Model, data: Path | None, sha256: str, poses: Poses | None = None
) -> tuple[Model, tuple[Notice, ...]]:
    """The model for the poses of a file, and a notice that names the effects that it leaves out, if any.

    On the data of its fit, on a part of them, and on the same file with rows added it is the whole model. On others
    effects of a session, such as a drift, would depend on unrelated numbers and times of poses.

    Args:
        data: the file; None if only its SHA-256 is known. sha256: of the file.
        poses: whose times are since the arm's power-on, which a joint's drift then follows; None: no such times.
    """
    deployed = as_deployed(model) if poses is None else as_deployed_at(model, poses)
    if not any(map(of_a_session, model.effects)) or model.fitted_to in (None, sha256):
        return model, ()
    if data is not None and _grown_from(data, model.fitted_to):
        return model, ()
    kept = {effect.name for effect in deployed.effects}
    gone = [effect.name for effect in model.effects if effect.name not in kept]
    if not gone:
        return deployed, ()
    return deployed, (Notice(NoticeKind.OTHER_DATA, ("" if data is None else data.name, *gone)),)


def _grown_from(data: Path, sha256: str | None) -> bool:
    """Whether a file begins with the lines of a file of this SHA-256."""
    try:
        lines = data.read_bytes().splitlines(keepends=True)
    except OSError:
        return False
    begun = hashlib.sha256()
    for line in lines:
        begun.update(line)
        if begun.hexdigest() == sha256:
            return True
    return False
