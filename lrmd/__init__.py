"""The daemon that drives the arm: one owner of the serial port, one process that talks, one that solves."""
