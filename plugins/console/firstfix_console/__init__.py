"""The console: routes for people who look at maps and answers, files for viewers, and the page that asks."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fastapi import FastAPI


def add_routes(app: FastAPI) -> None:
    """Add the console to a service; without its page where the setting ``console`` is off."""
    # not above: the shell loads the commands of this package without a web framework
    from . import answer_counts, answer_events, cloud, overlay, page, scan_report, thumbnail, viewer_file

    for module in (overlay, scan_report, cloud, thumbnail, viewer_file, answer_counts, answer_events):
        app.include_router(module.router)
    if app.state.settings.console:
        if page.page_files():  # packed here, not while queries wait
            app.state.pages["console"] = "console/"
        app.include_router(page.router)
