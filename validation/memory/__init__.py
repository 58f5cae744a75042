"""Worlds with a memory: plastic that creeps, servos that warm under load, screws that slip; and worlds without."""
