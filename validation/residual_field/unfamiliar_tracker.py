"""Tracker of the demo that sees an arm with two effects outside the catalogue: `BOARD PORT SEED`, until it is ended."""

from __future__ import annotations

from examples.demo.simulated_tracker import track
from validation.hidden_effects.data import true_arm
from validation.residual_field.closed_loop import unfamiliar

if __name__ == "__main__":
    track(lambda arm, seed: true_arm(unfamiliar(seed), seed, arm))
