"""Options of a query and the answer to it, as the robot sees them."""
