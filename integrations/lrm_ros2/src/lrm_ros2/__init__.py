"""Bridge between the daemon `lrmd` and ROS 2, without ROS installed: a client of both."""
