"""Gateways for fleets of robots: DDS and rmw_zenoh in place of ROS 2, and VDA 5050."""
