"""Dynamixel X servos: packets of protocol 2.0, registers, and what a bus has to know of them."""
