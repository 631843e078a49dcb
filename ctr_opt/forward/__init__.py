"""The forward problem: from actuation and loads to the robot's shape."""
