"""The files that a model goes into, each made of the robot's own where there is one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

from lrm_ident.data.robot_files import urdf_export as export
from lrm_ident.data.robot_files.lerobot_calibration import beyond_zeros, calibration_text, corrected, joint_config_text
from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.mjcf_patch import patched_mjcf
from lrm_ident.data.robot_files.mjcf_robot import read_mjcf
from lrm_ident.data.robot_files.ros2_control import with_offsets
from lrm_ident.data.robot_files.urdf import read_whole_urdf
from lrm_ident.measuring.motion.joint_dynamics import ISAAC
from lrm_math.effects import ParameterRef
from lrm_math.effects.compliance import Spring
from lrm_math.errors import FileError, LrmError
from lrm_math.model.model import Model

RIGID = (
    "this is the unloaded arm; where nothing else corrects the commands, the rigid arm nearest to the one that sags is "
    "that of a fit with --effects offsets"
)
Writer: TypeAlias = Callable[[Model, Path], export.ExportedFile]
"""Makes the file for a model that is written at a path. Raises `LrmError`."""


def writer_for(
    output: Path, sources: Mapping[str, Path], base: str | None, tip: str | None, keep: Sequence[str]
) -> Writer:
    """Exporters by name and by the robot's own file, of which `sources` has one at most, by its option.

    `base`, `tip`: links between which the arm stands. `keep`: places whose errors stay out. Raises `LrmError`.
    """
    if len(sources) > 1:
        raise LrmError(f"{' and '.join(sources)} are both given; one file is made of one")
    option, source = next(iter(sources.items()), ("", output))
    writers: dict[tuple[str, str], Writer] = {
        ("", ".xml"): lambda model, _: mjcf(_as_drawn(model, keep)),
        ("", ".mjcf"): lambda model, _: mjcf(_as_drawn(model, keep)),
        ("", ".urdf"): lambda model, _: _urdf(model, None, base, tip, keep),
        ("", ".json"): lambda model, _: export.ExportedFile("", ISAAC, export.left_out(model)),
        ("--urdf", ".urdf"): lambda model, _: _urdf(model, source, base, tip, keep),
        ("--mjcf", ".xml"): lambda model, path: patched_mjcf(
            _as_drawn(model, keep), read_mjcf(source), path, base, tip
        ),
        ("--calibration", ".json"): lambda model, _: _zeros(
            model, calibration_text(corrected(source, model)), "LeRobot calibration"
        ),
        ("--calibration", ".yaml"): lambda model, _: _zeros(
            model, joint_config_text(source, corrected(source, model)), "joint_config_file of feetech_ros2_driver"
        ),
        ("--ros2-control", output.suffix): lambda model, _: _zeros(
            model, with_offsets(source, model), f"{source.name} with the model's zeros"
        ),
    }
    if (base or tip) and output.suffix != ".urdf" and option != "--mjcf":
        raise LrmError("--base and --tip are for a URDF, or for the robot's own MJCF (--mjcf)")
    if (option, output.suffix) not in writers:
        right = ", ".join(end for name, end in writers if name == option)
        what = f"a {output.suffix or 'nameless'} file{f' of {option}' if option else ''}"
        raise FileError(output, "", what, f"name it {right}" if option else f"name it {right}, or give the robot's own")
    return writers[option, output.suffix]


def _urdf(
    model: Model, urdf: Path | None, base: str | None, tip: str | None, keep: Sequence[str]
) -> export.ExportedFile:
    robot = read_whole_urdf(urdf) if urdf else export.bare_urdf(model.arm)
    rigid = export.rigid_part(model, keep)
    text = export.corrected_urdf(rigid, robot, base, tip)
    off = export.exported_difference(rigid, text, base, tip)
    if urdf is None:
        text = export.mounted(text, model.constant_gravity)
    lost, what = (
        export.left_out(model, () if urdf else ("gravity",)),
        f"URDF (at most {off:.1g} m off the model's rigid part)",
    )
    sags = any(isinstance(effect, Spring) and effect.name in lost for effect in model.effects)
    return export.ExportedFile(text, what, lost, RIGID if sags else "")


def _zeros(model: Model, text: str, what: str) -> export.ExportedFile:
    """A file that holds the zero offsets of a model alone."""
    return export.ExportedFile(text, what, beyond_zeros(model))


def _as_drawn(model: Model, places: Sequence[str]) -> Model:
    """The model without the offsets of some places."""
    values = [
        0.0 if ParameterRef.parse(key).id == "offsets" and ParameterRef.parse(key).place in places else value
        for key, value in zip(model.keys, model.values.tolist(), strict=True)
    ]
    return model.with_values(values)
