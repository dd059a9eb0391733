"""What runs on the robot: ask for a fix, get a typed answer."""
