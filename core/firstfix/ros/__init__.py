"""Strict readers and writers of a few ROS messages, of bags and of topic keys, without ROS.

They need NumPy only, so they are part of the robot's installation.
"""
