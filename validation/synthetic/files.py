"""Files of a synthetic data set: measurements, their metadata, and the ground truth."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .generate import Dataset
from .ground_truth import LINK_KEYS, PLACEMENT_KEYS, GroundTruth
from .hidden_effect import HiddenEffect


def write(path: str | Path, data: Dataset, source: str) -> tuple[Path, Path, Path]:
    """Write NAME.csv, NAME.toml and NAME.truth.toml for path = .../NAME (or NAME.csv); return their paths."""
    stem = str(path).removesuffix(".csv")
    table, metadata, truth = (Path(stem + suffix) for suffix in (".csv", ".toml", ".truth.toml"))
    for file, text in ((table, _table(data)), (metadata, _metadata(data, source)), (truth, _truth(data))):
        _replace(file, text)
    return table, metadata, truth


def _replace(path: Path, text: str) -> None:
    """Atomic replacement: a reader never sees a partial file."""
    handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
        Path(draft).chmod(0o644)
        os.replace(draft, path)
    except BaseException:
        Path(draft).unlink(missing_ok=True)
        raise


def _table(data: Dataset) -> str:
    joints = [f"q{number}_deg" for number in range(1, data.q_rad.shape[1] + 1)]
    lines = [["pose", "t_s", "session", "payload_g", *joints, "x_mm", "y_mm", "z_mm"]]
    # adding zero turns -0.0 into 0.0
    q_deg = np.round(np.rad2deg(data.q_rad), 2) + 0.0
    tcp_mm = np.round(data.tcp_m * 1000.0, 4) + 0.0
    for row, (time, session) in enumerate(zip(data.schedule.time_s, data.schedule.session, strict=True)):
        cells = [str(row + 1), f"{time:.10g}", f"{session:.0f}", f"{data.payload_kg[row] * 1000.0:.10g}"]
        lines.append(cells + [f"{angle:.2f}" for angle in q_deg[row]] + [f"{x:.4f}" for x in tcp_mm[row]])
    return "".join(",".join(line) + "\n" for line in lines)


def _metadata(data: Dataset, source: str) -> str:
    return _toml(
        [
            ("schema", "lrm/measurements/1"),
            ("arm", data.arm.name),
            ("source", source),
            ("start_q_deg", np.round(np.rad2deg(data.schedule.start_q_rad), 2).tolist()),
            ("noise_sd_mm", _tidy(data.noise_sd_m * 1000.0)),
        ]
    )


def _truth(data: Dataset) -> str:
    truth = data.truth
    top: list[tuple[str, Any]] = [
        ("schema", "lrm/truth/1"),
        ("arm", data.arm.name),
        ("noise_seed", data.seed),
        ("noise_sd_mm", _tidy(data.noise_sd_m * 1000.0)),
        ("base_compliance_rad_per_nm", truth.base_compliance_rad_per_nm),
        ("joint_compliance_rad_per_nm", list(truth.joint_compliance_rad_per_nm)),
    ]
    note = (
        "\n# Rigid displacements of base, links and tool with all that hangs on them: rotation vector about the origin"
        "\n# of the frame they hang on (the base: its own), then shift; world axes at zero joint angles.\n"
    )
    tables = [_toml(top), "\n[deviation]\n", _toml(_deviations(truth)), note, "[displacement]\n", _displacements(truth)]
    return "".join([*tables, *(f"\n[[effect]]\n{_toml(_effect(effect))}" for effect in truth.effects)])


def _deviations(truth: GroundTruth) -> Iterator[tuple[str, float]]:
    """Only those that are not zero: most errors are displacements."""
    places = [(f"joint{n}", LINK_KEYS, row) for n, row in enumerate(truth.deviations.links, start=1)]
    ends = [("base", PLACEMENT_KEYS, truth.deviations.base), ("tool", PLACEMENT_KEYS, truth.deviations.tool)]
    for place, keys, values in [*places, *ends]:
        yield from ((f"{place}.{key}", value) for key, value in zip(keys, values, strict=True) if value != 0.0)


def _displacements(truth: GroundTruth) -> str:
    names = ["base", *(f"link{n}" for n in range(1, len(truth.displacements) - 1)), "tool"]
    rows = zip(names, truth.displacements, strict=True)
    return "".join(f"{name} = {{ turn_rad = {_value(row[:3])}, shift_m = {_value(row[3:])} }}\n" for name, row in rows)


def _effect(effect: HiddenEffect) -> list[tuple[str, Any]]:
    fields: dict[str, Any] = asdict(effect)  # type: ignore[call-overload]
    return [("kind", type(effect).__name__), *fields.items()]


def _toml(entries: Any) -> str:
    return "".join(f"{key} = {_value(value)}\n" for key, value in entries)


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, (bool, str)):
        return json.dumps(value, ensure_ascii=False)  # TOML writes these as JSON does
    return repr(value)


def _tidy(value: float) -> float:
    return float(f"{value:.10g}")
