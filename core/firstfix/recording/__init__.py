"""Recordings of robots: bags of ROS 1 and 2, and captures of packets, as clouds with times and frames."""
