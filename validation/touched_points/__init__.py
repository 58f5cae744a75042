"""Calibration by touched sockets: on public recordings of other arms, and on simulated ones."""
