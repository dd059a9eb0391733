"""firstfix: the pose of a LiDAR robot in a known map, from one scan."""

__version__ = "0.1.0"
