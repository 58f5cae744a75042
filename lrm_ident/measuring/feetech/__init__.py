"""Feetech STS servos: packets, registers, and what a bus has to know of them."""
