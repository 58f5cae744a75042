"""Trackers: where a moving target is, whatever device says so."""
