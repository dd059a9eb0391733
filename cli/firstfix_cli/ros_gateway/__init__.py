"""Gateway for robots on rmw_zenoh: finds the first fix of every robot of a fleet."""
