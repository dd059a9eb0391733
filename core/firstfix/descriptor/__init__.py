"""What a scan looks like from where it was taken: NumPy alone, for builder, service and robot.

PcaScanContext    the paper's PCA-SC, its CNZ key and its column similarity
LayeredOccupancy  the default: occupancy by height layers, keyed by its ring spectrum
"""

from .base import Described, Descriptor, rows_of
from .occupancy import LayeredOccupancy
from .pca_sc import PcaScanContext
from .polar import PolarGrid
from .scan_batch import ScanBatch

__all__ = [
    "Described",
    "Descriptor",
    "LayeredOccupancy",
    "PcaScanContext",
    "PolarGrid",
    "ScanBatch",
    "rows_of",
]
