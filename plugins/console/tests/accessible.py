"""Checks a page with axe-core, by the rules of WCAG 2 and 2.1, levels A and AA."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

from plugins.console.tests.page import Page

AXE = Path(__file__).parents[1] / "page/node_modules/axe-core/axe.min.js"
_LEVELS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa")
_OF_COLOURS = ("color-contrast", "link-in-text-block")


def violations(page: Page, *, of_colours: bool = False) -> list[str]:
    """Returns "rule: element" for everything that is wrong.

    Args:
        of_colours: only by the rules of colours. The dark page and the light one differ in nothing else.
    """
    if not page.js("!!globalThis.axe"):
        page.js(_source())
    chosen = {"type": "rule", "values": _OF_COLOURS} if of_colours else {"type": "tag", "values": _LEVELS}
    options = json.dumps({"runOnly": chosen, "resultTypes": ["violations"]})
    return list(
        page.js(
            f"axe.run(document, {options}).then((found) =>"
            " found.violations.flatMap((rule) => rule.nodes.map((node) =>"
            " `${rule.id}: ${node.html.slice(0, 150)} ${node.failureSummary}`)))"
        )
    )


@cache
def _source() -> str:
    return f"{AXE.read_text()}; undefined"
