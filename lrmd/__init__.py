"""Daemon of the robot arm, in three processes: ramp (serial port), api (zenoh, state machine), ik (kinematics)."""
