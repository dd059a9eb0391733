"""Descriptors of scans. They need NumPy only, for builder, service and robot.

LayeredOccupancy is the default: occupancy by height layers, with its ring spectrum as key. The paper's
PCA-SC, its CNZ key and its column similarity are in ``pca_sc``, which no robot needs.
"""

from .base import Described, Descriptor, rows_of
from .occupancy import LayeredOccupancy
from .polar import PolarGrid
from .scan_batch import ScanBatch

__all__ = [
    "Described",
    "Descriptor",
    "LayeredOccupancy",
    "PolarGrid",
    "ScanBatch",
    "rows_of",
]
