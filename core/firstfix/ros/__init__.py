"""ROS messages, bags and topic keys without ROS: small strict readers and writers of the few that are needed.

They need NumPy alone, so they are part of what a robot installs; only ``bag`` needs rosbags.
"""
