"""Closed loop on the simulated board, while a joint warms up, the tracker is pushed and the base leans."""
