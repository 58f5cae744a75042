"""Feetech servos on a serial bus: packets, registers, and an arm of them."""
