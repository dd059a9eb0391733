"""Removal of spaces from Python source. Every statement stays on its line."""

from __future__ import annotations

import io
import tokenize
from collections.abc import Iterator
from itertools import pairwise

_LAYOUT = {tokenize.INDENT, tokenize.DEDENT, tokenize.NEWLINE, tokenize.NL, tokenize.ENDMARKER}


def strip_spaces(source: str) -> str:
    """Returns the module without spaces around operators, and with narrow indents.

    Args:
        source: a module without comments.
    """
    lines = source.splitlines()
    tokens = list(tokenize.generate_tokens(io.StringIO(source).readline))
    for row, begin, end in sorted(_gaps(tokens), reverse=True):
        if lines[row - 1][begin:end].isspace():
            lines[row - 1] = lines[row - 1][:begin] + lines[row - 1][end:]
    of_texts = {
        row
        for token in tokens
        if token.type == tokenize.STRING or token.type == getattr(tokenize, "FSTRING_MIDDLE", None)
        for row in range(token.start[0] + 1, token.end[0] + 1)
    }
    for number, line in enumerate(lines, 1):
        if number not in of_texts:
            code = line.lstrip(" ")
            lines[number - 1] = " " * ((len(line) - len(code)) // 4) + code
    return "\n".join(lines) + "\n"


def _gaps(tokens: list[tokenize.TokenInfo]) -> Iterator[tuple[int, int, int]]:
    """Row, begin and end of the spaces beside operators, outside of formatted texts."""
    texts = 0  # formatted texts that are open: Python 3.12 has tokens of their parts
    for before, token in pairwise(tokens):
        name = tokenize.tok_name[before.type]
        texts += (name == "FSTRING_START") - (name == "FSTRING_END")
        beside = tokenize.OP in (before.type, token.type) and not {before.type, token.type} & _LAYOUT
        is_decimal = before.type == tokenize.NUMBER and token.string == "."  # 1 .real is not 1.real
        if beside and not is_decimal and not texts and before.end[0] == token.start[0]:
            yield token.start[0], before.end[1], token.start[1]
