"""Limits of the PCA9685 (NXP data sheet, rev. 4, section 7.3.5); no imports, for the real-time process."""

COUNTS_PER_PERIOD = 4096
PRESCALE_MIN, PRESCALE_MAX = 3, 255
