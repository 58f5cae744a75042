"""Recordings that other programs made of a tracker, and the measurements that are in them."""
