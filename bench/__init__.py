"""Our figures beside the peers', times of calibrated inverse kinematics and of the daemon. Run it with `make bench`."""
