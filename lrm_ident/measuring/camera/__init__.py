"""A webcam and a printed board as the tracker (extra `camera`)."""
