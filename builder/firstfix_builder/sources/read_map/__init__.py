"""Maps as users have them, to points or a mesh in a local frame with z up.

read_map         a file, a SLAM package's folder or one of scans -> MapData
read_parts       the same, or a folder of meshes -> MapData file by file
read_trajectory  a file of poses -> (m, 4, 4)
"""

from __future__ import annotations

from .map_data import MapData
from .read_map import Axis, read_map, read_parts
from .trajectory import read_trajectory

__all__ = ["Axis", "MapData", "read_map", "read_parts", "read_trajectory"]
