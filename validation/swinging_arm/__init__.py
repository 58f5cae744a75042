"""The simulated rover's arm swings: settling times, moves with and without a shaper, a campaign."""
