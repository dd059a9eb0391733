"""Gateway for robots on DDS, the usual middleware of ROS 2. It needs the package cyclonedds, and no ROS."""
