"""The simulated rover's arm swings: settling times of moves with and without a shaper."""
