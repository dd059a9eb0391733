"""Imports open3d without its plots for web browsers, or says which libraries of the system it lacks.

The builder has no use for the plots. They import Dash and Plotly, which takes longer than the rest of open3d.
"""

from __future__ import annotations

import sys
from types import ModuleType

_PLOTS = "open3d.visualization.draw_plotly"


def _nothing_to_look_at(*_: object, **__: object) -> None:
    raise RuntimeError(f"{_PLOTS} is left out by {__name__}")


if _PLOTS not in sys.modules:
    _left_out = ModuleType(_PLOTS)
    for _name in ("get_plotly_fig", "draw_plotly", "draw_plotly_server"):
        setattr(_left_out, _name, _nothing_to_look_at)
    sys.modules[_PLOTS] = _left_out

try:
    import open3d as o3d
except ModuleNotFoundError:
    raise
except (ImportError, OSError) as error:  # it links them even where there is no screen
    libraries = "libgl1 libegl1 libx11-6 libudev1 libusb-1.0-0 libidn2-0 libgomp1"
    raise ImportError(f"open3d cannot be loaded ({error}): apt-get install {libraries}") from error

__all__ = ["o3d"]
