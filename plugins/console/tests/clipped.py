"""Elements that do not fit into the page: people would have to scroll sideways, or never see them."""

from __future__ import annotations

from plugins.console.tests.page import Page

_FIND = """
[...document.querySelectorAll('html, #app *')]
  .filter((e) => e.getClientRects().length && e.scrollWidth > e.clientWidth + 1
    && !['visible', 'clip'].includes(getComputedStyle(e).overflowX) && !e.closest('.map-canvas, .unseen, pre')
    && getComputedStyle(e).textOverflow !== 'ellipsis'
    || e === document.documentElement && e.scrollWidth > innerWidth)
  .map((e) => `${e.tagName.toLowerCase()}.${e.className}: ${e.scrollWidth - e.clientWidth} px too wide`)
"""


def clipped(page: Page) -> list[str]:
    """The elements that are wider than their place, as sentences. Code and the picture of a map may be."""
    return list(page.js(_FIND))
