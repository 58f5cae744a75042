"""The daemon's skills as states of state machines."""
