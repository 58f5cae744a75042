"""LeRobot's real `SOFollower` over the simulated Feetech bus, with and without the calibrated form around it."""
