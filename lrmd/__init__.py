"""Daemon of the robot arm, in four processes: ramp (serial port), api (state machine), ik (kinematics), router."""
