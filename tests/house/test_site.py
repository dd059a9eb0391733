"""The documentation site builds without a warning and loads nothing from outside."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
NEEDED = ("mkdocs", "material", "mkdocstrings_handlers", "latex2mathml")
OUTSIDE = re.compile(r"^(https?:)?//", re.IGNORECASE)
# What a browser fetches by itself; a link in the text is followed by the reader alone.
FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "link": "href"}


class Fetches(HTMLParser):
    """Collects the addresses that a page makes a browser fetch."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in FETCHED and given.get("rel") not in ("canonical", "next", "prev"):
            self.found.append(given.get(FETCHED[tag]) or "")
        self.found += re.findall(r"url\((.*?)\)", given.get("style") or "")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: pip install '.[docs,service]'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=REPO, env=environment, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return folder


def test_every_page_is_built(site: Path):
    sources = list((REPO / "docs").rglob("*.md"))
    assert len(list(site.rglob("*.html"))) > len(sources)
    for page in sources:
        assert (site / page.relative_to(REPO / "docs")).with_suffix(".html").is_file()


def test_nothing_is_loaded_from_outside(site: Path):
    outside = {}
    for page in site.rglob("*.html"):
        fetched = Fetches(page.read_text()).found
        assert fetched, f"{page.name} has no style sheet"
        if found := [address for address in fetched if OUTSIDE.match(address.strip("'\" "))]:
            outside[page.relative_to(site).as_posix()] = found
    for sheet in site.rglob("*.css"):
        if found := [
            u
            for u in re.findall(r"(?:url\(|@import )['\"]?([^'\")]*)", sheet.read_text())
            if OUTSIDE.match(u)
        ]:
            outside[sheet.relative_to(site).as_posix()] = found
    assert not outside


def test_what_is_generated_is_there(site: Path):
    assert "firstfix maps rollback" in (site / "reference" / "cli.html").read_text()
    assert "descriptor_mismatch" in (site / "reference" / "errors.html").read_text()
    assert (
        "/maps/{map_id}/versions/{version}/activate"
        in (site / "reference" / "http-endpoints.html").read_text()
    )
    assert "no sensor preset" in (site / "reference" / "wrong-maps.html").read_text()
    assert "unit_millimetres" in (site / "reference" / "wrong-inputs.html").read_text()
    assert "roll_back" in (site / "reference" / "python-api.html").read_text()
    assert "<math" in (site / "method.html").read_text()
    assert "localized" in (site / "notebooks" / "first_fix.html").read_text()
    assert (site / "notebooks" / "first_fix" / "output-1.png").is_file()


def test_a_link_to_what_a_page_is_made_from_leads_to_the_page(site: Path):
    page = (site / "reference" / "index.html").read_text()
    assert all(
        f'href="{name}.html"' in page
        for name in ("cli", "errors", "http-endpoints", "wrong-inputs", "wrong-maps")
    )


def test_marked_sections_are_tabs(site: Path):
    page = (site / "how-to" / "deploy.html").read_text()
    labels = re.findall(r'<label for="[^"]*">([^<]*)</label>', page)
    assert [one for one in labels if one] == ["Compose", "Kubernetes", "Images", "Many machines", "Sizing"]
    assert "tabs --&gt;" not in page
    assert "\n///" not in page


def test_a_fetch_from_outside_would_be_seen():
    page = '<script src="//cdn.example/x.js"></script><img src="a.png"><a href="https://example.org">'
    assert [address for address in Fetches(page).found if OUTSIDE.match(address)] == ["//cdn.example/x.js"]
