"""`python -m validation.swinging_arm.picture FILE`: the tip after one move, without and with a shaper."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from validation.swinging_arm.rig import SwingingRover

PWM_HZ, SHOWN_S = 330.0, 2.5
MOVE = np.array([0.8, -0.5, 0.4, 0.6, 0.0, 0.0])
LOOKS = {"off": ("without shaping", "#b3261e"), "zv": ("shaped (zv)", "#1b6e3c")}


def draw(path: Path) -> None:
    """Distance of the tip from where it comes to rest, from the end of each command on."""
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    axes = figure.subplots()
    for kind, (label, colour) in LOOKS.items():
        rover = SwingingRover(PWM_HZ, kind, within_mm=0.5)
        seconds, leg = rover.move(MOVE)
        settle = rover.known.settling(leg).usual
        tips = rover.tips(round(10.0 / rover.tick_s))
        away = 1e3 * np.linalg.norm(tips - tips[-1], axis=1)
        t = rover.tick_s * np.arange(1, len(away) + 1)
        shown = t < SHOWN_S
        words = f"{label}: move {seconds:.2f} s, settle_s {settle:.2f} s"
        axes.plot(t[shown], away[shown], color=colour, label=words)
        axes.axvline(settle, color=colour, linestyle=":", linewidth=1.0)
        print(f"{kind}: move {seconds:.2f} s, settle_s {settle:.2f} s, largest swing {away.max():.2f} mm")
    axes.axhline(0.5, color="0.6", linewidth=0.8)
    axes.set(xlabel="time after the end of the command (s)", ylabel="tip from its rest (mm)", xlim=(0.0, SHOWN_S))
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
