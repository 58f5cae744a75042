"""Tracker of the arm of a seed, warming up anew, pushed and leaning: `BOARD PORT SEED`, until it is ended."""

from __future__ import annotations

from examples.demo.simulated_tracker import send
from validation.as_deployed.board.passing_world import PassingWorld

if __name__ == "__main__":
    send(lambda board, seed: PassingWorld(seed).afterwards(board))
