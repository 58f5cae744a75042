"""Speed, punctuality and faults of the daemon: real processes on a simulated board."""
