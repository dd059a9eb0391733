"""The packed points of a version's cloud for viewers (``cloud.bin``), and their intensity beside them.

``cloud_intensity.bin``, which only maps with an intensity have, has a byte for each point of ``cloud.bin``,
in the same order; not for the marks.
"""

from __future__ import annotations

import numpy as np

# at: in 1/65535 of the node's edge from its low corner; normal: octahedral, in 1/127
POINT = np.dtype([("at", "<u2", 3), ("normal", "i1", 2)])
NO_NORMAL = -128  # both numbers, where a point has none
STEPS = 65535  # along the edge of a node
MAX_INDEX_BYTES = 64 << 20  # of ``cloud.json``, the index of the nodes
