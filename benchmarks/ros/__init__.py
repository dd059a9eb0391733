"""The gateway for robots with ROS: what it adds to a query, and its memory."""
