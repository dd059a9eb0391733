"""A ROS 2 node over the firstfix client."""
