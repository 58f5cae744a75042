"""Bare servos on a serial bus, whatever protocol they speak: a host of the line, and an arm of them."""
