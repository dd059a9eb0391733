"""/docs in a real browser, from the console on: Swagger UI under the service's own rules."""

from __future__ import annotations

from pathlib import Path

import pytest

from plugins.console.tests import browser as browsers
from tests.service.service_world import running_service


@pytest.mark.slow
def test_the_console_leads_to_the_page_of_the_api_which_asks_the_service_alone(tmp_path: Path):
    with (
        running_service(tmp_path / "service", zenoh=False) as service,
        browsers.running_browser(tmp_path / "browser") as browser,
        browser.page(service.url, is_first_visit=True) as page,
    ):
        page.call("Page.navigate", url=f"{service.url}/console/")
        page.wait("nav a", "HTTP API")
        page.js("find('nav a', 'HTTP API').click()")
        page.until("!!document.querySelector('.opblock-summary-path')", "the calls")
        assert "firstfix" in page.text(".info")
        assert page.has(".opblock-summary-path", "/localize")
        page.js("document.querySelector('[id$=get_caller_caller_get] .opblock-summary-control').click()")
        page.click(".try-out__btn", "Try it out")
        page.click(".execute", "Execute")
        page.until("!!document.querySelector('.live-responses-table')", "an answer")
        assert "GET /caller" in page.asked
        assert page.problems == []
