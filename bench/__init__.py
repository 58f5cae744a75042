"""Our figures beside the peers'. Run it with `make bench`."""
