"""The console: routes for people who look at maps and answers, and the page that asks them."""

from __future__ import annotations

from fastapi import FastAPI

from . import answer_counts, answer_events, cloud, overlay, page


def add_routes(app: FastAPI) -> None:
    """Add the console to a service; without its page where the setting ``console`` is off."""
    for module in (overlay, cloud, answer_counts, answer_events):
        app.include_router(module.router)
    if app.state.settings.console:
        if page.page_files():  # packed here, not while queries wait
            app.state.pages["console"] = "console/"
        app.include_router(page.router)
