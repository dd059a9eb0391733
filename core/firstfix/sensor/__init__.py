"""Sensor models: the rays of a LiDAR and its mounting, for the simulator."""

from .model import SensorModel, preset, presets

__all__ = ["SensorModel", "preset", "presets"]
