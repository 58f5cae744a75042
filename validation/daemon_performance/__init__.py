"""How fast and how punctual the daemon is, and how it takes faults: real processes on a simulated board."""
