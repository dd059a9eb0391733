"""`make test` runs a smoke test of each package that may be left out; their other tests are ``slow``."""

from __future__ import annotations

import pytest

PACKAGES = ("plugins/", "lab/")
SMOKE = (
    "lab/tests/test_lab_smoke.py",
    "plugins/console/tests/routes/test_http_page.py",
    "plugins/console/tests/test_console_main_path.py",
    "plugins/fleet/tests/vda5050/test_vda5050_fix.py",
)


@pytest.hookimpl(tryfirst=True)  # before the marks choose
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.nodeid.startswith(PACKAGES) and not item.nodeid.startswith(SMOKE):
            item.add_marker(pytest.mark.slow)
    # A worker that begins a slow file at the end would leave the others idle.
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)
