"""Reader of ROS messages with arrays of structs: points, and packets."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..ros.cdr import MessageReader


class StructReader(MessageReader):
    """Reads one serialised message from its beginning, see ``MessageReader``."""

    @property
    def place(self) -> int:
        """Index of the next byte in the body."""
        return self._place

    @property
    def byte_order(self) -> str:
        """``<`` or ``>``."""
        return self._order

    def structs(self, layout: np.dtype[Any], count: int) -> NDArray[Any]:
        """Read structs of a fixed size as a view.

        Args:
            layout: packed; no member is aligned to over four bytes in CDR, and the first one to four.
            count: (n,) of the result, which the caller has limited.

        Raises:
            MalformedData: the message is cut off.
        """
        stride = layout.itemsize if self.ros1 else layout.itemsize + -layout.itemsize % 4
        if count and not self.ros1:
            self._place += -(self._place - self._start) % 4
        data = self._take(
            stride * (count - 1) + layout.itemsize if count else 0
        )  # no padding follows the last
        ordered = layout.newbyteorder(">" if self._order == ">" else "<")
        return np.ndarray((count,), ordered, data, strides=(stride,))
