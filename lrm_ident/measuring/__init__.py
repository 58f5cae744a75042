"""Measurements from trackers, cameras, recordings, and campaigns with the arm itself."""
