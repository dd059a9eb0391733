from __future__ import annotations

import sys

import pytest


@pytest.fixture(autouse=True)
def without_the_node():
    """Removes the node after each test."""
    yield
    sys.modules.pop("firstfix_ros.node", None)  # it was imported over stand-ins
