"""Inverse kinematics: joint angles from where the tool shall be."""
