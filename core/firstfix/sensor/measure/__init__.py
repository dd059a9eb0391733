"""Measuring of an unknown sensor from its scans."""

from .measure import MeasuredScan, MeasuredSensor, measure_sensor

__all__ = ["MeasuredScan", "MeasuredSensor", "measure_sensor"]
