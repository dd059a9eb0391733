"""Description of a query for the coarse index, as if its scans had been taken at spots around as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from pydantic import TypeAdapter

from ...answer.options import LocalizeOptions
from ...descriptor import Described, Descriptor, LayeredOccupancy, ScanBatch
from ...native import turned_occupied_cells
from ...scan.compact import CompactScan, ScanDescriptor
from ...scan.levelling import turned
from ...scan.reduction import at_most
from ...scan.scan import Scan
from ...scan.sequence import AnyScan, ScanSequence
from ..config import DescriptorConfig, PreprocessConfig
from ..preprocess import PreparedScan, preprocess

# A template is seldom nearer than 0.2 m, and by then half of the filled cells are others. The scan is
# therefore also described from spots around: of 16 office floors, the right one came first for 23 of 24
# queries instead of 9.
SHIFTS_M = tuple(product((0.0, -0.2, 0.2), repeat=2))
MAX_POINTS = 16_384  # that are described: as many rays as a template has
_CONFIG: TypeAdapter[DescriptorConfig] = TypeAdapter(DescriptorConfig)


@dataclass(frozen=True)
class SoughtScan:
    """A query, described for the coarse index.

    Attributes:
        described: for each form of descriptor, one description for each scan: a row for each spot.
    """

    described: Mapping[str, tuple[Described, ...]]


def describe_sought(
    scan: AnyScan | ScanDescriptor, options: LocalizeOptions, forms: Sequence[str]
) -> SoughtScan:
    """Describe a query in the given forms.

    A descriptor alone has the forms that agree with it. A scan with too few points has none.

    Args:
        forms: see ``CoarseTemplates.form``.
    """
    descriptors = {form: _CONFIG.validate_json(form).make() for form in forms}
    if isinstance(scan, ScanDescriptor):
        agreeing = [form for form, descriptor in descriptors.items() if scan.agrees_with(descriptor)]
        return SoughtScan(dict.fromkeys(agreeing, (scan.rows,)))
    sequence = ScanSequence.single(scan) if isinstance(scan, (Scan, CompactScan)) else scan
    mounting = options.T_base_sensor
    prepared = preprocess(
        sequence,
        options.gravity,
        PreprocessConfig(),
        None if mounting is None else mounting[:3, :3],
        twist=options.twist,
    )
    if prepared is None:
        return SoughtScan({})
    return SoughtScan(
        {
            form: tuple(_from_around(one, descriptor) for one in prepared.scans)
            for form, descriptor in descriptors.items()
        }
    )


def _from_around(scan: PreparedScan, descriptor: Descriptor) -> Described:
    """Descriptions of a scan, one for each spot."""
    points = turned(at_most(scan.seen, MAX_POINTS), scan.R_level_sensor)
    upright, found = np.eye(3), []
    for x_m, y_m in SHIFTS_M:
        moved = points - np.array([x_m, y_m, 0.0], np.float32)
        if isinstance(descriptor, LayeredOccupancy):
            grid = descriptor.grid
            form = grid.rings, grid.sectors, grid.max_range_m, np.asarray(descriptor.edges_m, np.float32)
            found.append({"occupancy": turned_occupied_cells(moved, upright, scan.height_m, *form)})
        else:
            found.append(descriptor.describe(ScanBatch.single(moved, scan.height_m)))
    return {name: np.concatenate([one[name] for one in found]) for name in descriptor.arrays}
