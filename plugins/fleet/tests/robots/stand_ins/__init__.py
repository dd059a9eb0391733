"""Localizers as their projects' nodes meet the world, in rclpy: names, types, QoS and what they ignore.

They need a sourced ROS 2 (``tests/robots/real_ros.py``). What each project does was read in the source that
its file names.
"""
