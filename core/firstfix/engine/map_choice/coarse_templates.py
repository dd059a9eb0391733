"""Templates of one map version, in an order in which the first of them stand evenly over the map."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from ...descriptor import Described, ScanBatch, rows_of
from ...errors import CorruptVersion
from ..config import ENGINE_FILE, DescriptorConfig
from ..retrieval.cascade import PREFIX

MAX_TEMPLATES = 2048  # of one map: 0.5 m apart they cover a floor, and 3 m apart a town
_CONFIG: TypeAdapter[DescriptorConfig] = TypeAdapter(DescriptorConfig)


@dataclass(frozen=True)
class CoarseTemplates:
    """Some templates of a map version, n of them.

    Attributes:
        form: parameters of the descriptor as JSON. Templates of equal forms can be compared.
        described: their descriptions, n rows. For every k, the first k stand evenly over the map.
    """

    form: str
    described: Described

    def __len__(self) -> int:
        return len(next(iter(self.described.values())))

    def first(self, count: int) -> CoarseTemplates:
        """The first templates."""
        return CoarseTemplates(self.form, rows_of(self.described, slice(count)))

    @classmethod
    def of(
        cls, config: DescriptorConfig, position_m: NDArray[np.floating], described: Described
    ) -> CoarseTemplates:
        """Up to MAX_TEMPLATES of a version's templates.

        Args:
            position_m: (n, 3) of the templates.
            described: their descriptions, n rows.
        """
        order = spread_order(position_m, MAX_TEMPLATES)
        return cls(config.model_dump_json(), rows_of(described, order))

    @classmethod
    def read(cls, read: Callable[[str], bytes]) -> CoarseTemplates:
        """Read what is needed of a version's files, and no others.

        Args:
            read: returns the content of a file by its name.

        Raises:
            CorruptVersion: a file is damaged, or does not fit the others.
        """
        try:
            config = _CONFIG.validate_python(json.loads(read(ENGINE_FILE))["descriptor"])
            position_m = _array(read(f"{PREFIX}position_m.npy"))
            descriptor = config.make()
            described = {name: _array(read(f"{PREFIX}{name}.npy")) for name in descriptor.arrays}
        except (ValueError, TypeError, KeyError, EOFError) as error:
            raise CorruptVersion(f"templates: {error}") from error
        count = len(position_m) if position_m.ndim else 0
        if position_m.shape != (count, 3) or not count or not np.isfinite(position_m).all():
            raise CorruptVersion(f"{PREFIX}position_m.npy has no positions of templates")
        nothing = descriptor.describe(ScanBatch.single(np.zeros((0, 3), np.float32), 1.0))
        for name, array in described.items():  # another width would spoil the block of all maps
            right = nothing[name]
            if array.shape != (count, *right.shape[1:]) or array.dtype != right.dtype:
                raise CorruptVersion(f"{PREFIX}{name}.npy does not fit the descriptor and the positions")
        return cls.of(config, position_m, described)


def spread_order(position_m: NDArray[np.floating], most: int) -> NDArray[np.intp]:
    """Rows of (n, 3) positions, each the one that is farthest from all rows before it: (min(n, most),)."""
    order = np.zeros(min(most, len(position_m)), np.intp)
    away2 = np.full(len(position_m), np.inf)
    for number in range(1, len(order)):
        off = position_m - position_m[order[number - 1]]
        np.minimum(away2, (off * off).sum(axis=1), out=away2)
        order[number] = away2.argmax()
    return order


def _array(content: bytes) -> NDArray[Any]:
    array: NDArray[Any] = np.load(io.BytesIO(content), allow_pickle=False)
    return array
