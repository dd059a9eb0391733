"""A robot's gateway on rclpy: the edge that the node and the fleet's gateway share."""
