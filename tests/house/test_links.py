"""Every link between the repository's pages leads somewhere."""

import re
import subprocess
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[2]
PAGE = re.compile(r"\bdocs/(?:how-to|concepts|reference)/[a-z0-9-]+\.md\b")
LINK = re.compile(r"\]\((?!https?:)([^)\s#]*)(?:#([^)\s]+))?\)")


def pages() -> list[Path]:
    listing = subprocess.run(
        ["git", "ls-files", "*.md"], cwd=REPO, capture_output=True, text=True, check=False
    )
    if listing.returncode:
        pytest.skip("needs a git checkout, which knows what belongs to it: git clone")
    return [REPO / name for name in listing.stdout.splitlines()]


def anchors(page: Path) -> set[str]:
    """Anchors of the page's headings, in the form of repository viewers."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_link_leads_somewhere():
    broken = []
    for page in pages():
        for target, anchor in LINK.findall(page.read_text()):
            found = (page.parent / target).resolve() if target else page
            if not found.exists() or (anchor and anchor not in anchors(found)):
                broken.append(f"{page.relative_to(REPO)}: {target}#{anchor}")
    assert not broken


def test_every_page_that_the_code_names_exists():
    """Errors, findings and comments name pages by their paths in the repository."""
    folders = ("core", "builder", "service", "cli", "clients", "console/src", "native", "deploy", "tests")
    listing = subprocess.run(
        ["git", "ls-files", "Dockerfile", *folders], cwd=REPO, capture_output=True, text=True, check=True
    )
    named, missing = 0, []
    for name in listing.stdout.splitlines():
        if Path(name).suffix in (".md", ".png", ".npz", ".bin", ".ply", ".pcd"):
            continue
        for page in PAGE.findall((REPO / name).read_text(errors="ignore")):
            named += 1
            if not (REPO / page).is_file():
                missing.append(f"{name}: {page}")
    assert named > 30
    assert not missing


def test_every_file_on_the_way_of_a_map_exists():
    """The drawing, whose boxes say below which folder their names are; and the table of other ways."""
    page = (REPO / "docs/concepts/way-of-a-map.md").read_text()
    _, drawing, others = page.split("```")
    _, *boxes = re.split(r"names are paths in ([\w/]+)", drawing)
    drawn = [
        REPO / folder / (name if name.endswith("/") else f"{name}.py")
        for folder, box in zip(boxes[::2], boxes[1::2], strict=True)
        for name in re.findall(r"^ │ (\w+(?:/\w+)*/?) ", box, re.M)
    ]
    assert len(drawn) > 20
    assert [str(path) for path in drawn if not path.exists()] == []
    packages = [REPO / folder for folder in boxes[::2]]
    named = re.findall(r"`(\w+(?:/\w+)+(?:\.py|/))`", others.partition("\n## Why")[0])
    assert len(named) > 8
    assert [name for name in named if not any((root / name).exists() for root in [REPO, *packages])] == []
