"""The keys of the templates that stand for their clusters, on disk: a million are half a gigabyte."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Descriptor
from firstfix.engine.retrieval.cascade import Templates

from ..mesh.mapped_array import mapped_scratch

AT_ONCE = 4096  # an eighth of a gigabyte of spectra


def make_keys(
    templates: Templates,
    rows: NDArray[np.integer],
    descriptor: Descriptor,
    projection: NDArray[np.float32] | None,
    scratch: Path,
) -> NDArray[np.float32]:
    """(n, numbers) of (n,) templates.

    Args:
        projection: (d, numbers) that keys are multiplied by, or None.
        scratch: folder of the file that they are kept in, which goes with the array.
    """
    whole: NDArray[np.float32] | None = None
    for start in range(0, len(rows), AT_ONCE):
        keys = descriptor.keys(templates.described_at(rows[start : start + AT_ONCE]))
        keys = keys if projection is None else keys @ projection
        if whole is None:
            with TemporaryFile(dir=scratch) as file:
                whole = mapped_scratch(file, np.float32, (len(rows), keys.shape[1]))
        whole[start : start + AT_ONCE] = keys
    assert whole is not None
    return whole
