"""Descriptions of robots in other formats: URDF and MJCF, in and out."""
