"""A simulated SO-101: a bus of Feetech servos on a pseudo-terminal, and an arm with hidden effects behind it."""
