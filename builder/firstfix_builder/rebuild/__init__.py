"""What a build keeps of the version before: learned keys and calibration, where little has changed."""
