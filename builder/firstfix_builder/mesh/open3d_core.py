"""Imports open3d without its plots for web browsers.

The builder does not use them. They import Dash and Plotly, which takes longer than all the rest of open3d.
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

import open3d as o3d  # noqa: E402

__all__ = ["o3d"]
