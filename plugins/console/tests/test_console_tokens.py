"""The console's colours, sizes of type and spaces come from one set of tokens, in its main style sheet."""

from __future__ import annotations

import re
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[1] / "page" / "src"
TOKEN_READERS = (
    "map3d",
    "maps",
    "versions",
    "ui",
    "recorded-queries",
    "access",
    "scan",
    "live",
    "earth",
    "patch",
    "api",
)
# "#fff", "rgb(", "0x12ab34": what is a colour in a style sheet or for three.js
COLOUR = re.compile(r"#[0-9a-fA-F]{3,8}\b|\b(?:rgba?|hsla?|oklch|light-dark)\(|\b0x[0-9a-fA-F]{6}\b")
NAMED = re.compile(r":[^;{}]*\b(?:white|black|red|green|blue|gr[ae]y|orange|yellow)\b(?![-(])")


def sheet() -> tuple[str, str]:
    """The tokens' rule, and all others: those of views too."""
    sheets = (SOURCES / "style.css", *sorted(SOURCES.rglob("*/*.css")))
    text = "\n".join(re.sub(r"/\*.*?\*/", "", one.read_text(), flags=re.DOTALL) for one in sheets)
    tokens, rest = text.split("}", 1)
    assert tokens.startswith(":root {")
    return tokens, rest


def test_a_colour_is_told_from_other_text():
    for text in ("#fff", "#10161bcc", "rgb(1 2 3)", "0x10161b", "light-dark(#fff, #000)"):
        assert COLOUR.search(text), text
    for text in ("#/maps/hall", "0xffffffff", "var(--ink)"):
        assert not COLOUR.search(text), text
    assert NAMED.search("a { color: white; }")
    assert not NAMED.search("td { white-space: nowrap; }")


def test_no_rule_has_a_colour_of_its_own():
    _, rest = sheet()
    assert not COLOUR.findall(rest)
    assert not NAMED.findall(rest)


def test_no_rule_has_a_size_of_type_of_its_own():
    _, rest = sheet()
    sizes = re.findall(r"font-size:\s*([^;}]+)", rest)
    assert sizes
    own = {one.strip() for one in sizes if not one.strip().startswith("var(--type-")}
    assert own <= {"1rem", "11px"}  # the page's own size, and the units of a picture


def test_the_sources_take_their_colours_from_the_tokens():
    found = [
        f"{path.relative_to(SOURCES)}: {colour}"
        for folder in TOKEN_READERS
        for path in (SOURCES / folder).rglob("*.ts*")
        for colour in COLOUR.findall(path.read_text())
    ]
    assert not found


def test_every_token_that_is_used_is_there_and_every_one_is_used():
    tokens, rest = sheet()
    defined = set(re.findall(r"(--[a-z0-9-]+):", tokens)) | set(re.findall(r"(--[a-z0-9-]+):", rest))
    named = set(re.findall(r"var\((--[a-z0-9-]+)\)", tokens + rest))
    sources = "\n".join(path.read_text() for path in SOURCES.rglob("*.ts*"))
    in_sources = {
        f"--{name}" for name in re.findall(r"[\"`]((?:picture|points|mark|heat|plot)-[a-z]+)", sources)
    }
    in_sources |= {f"--heat-{end}" for end in ("none", "half", "all")}
    in_sources |= {f"--mark-{verdict}" for verdict in ("localized", "ambiguous", "rejected")}
    assert named | in_sources <= defined
    assert defined <= named | in_sources, defined - named - in_sources
