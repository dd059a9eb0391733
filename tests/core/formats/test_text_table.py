"""The parser of rows of numbers."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData
from firstfix.formats import text_table
from firstfix.formats.text_table import MAX_LINE_BYTES, PIECE_BYTES, parse_rows
from tests.every_case import every_case

ROWS = np.arange(600_000, dtype=np.float64).reshape(-1, 4)
TEXT = b"".join(b"%d %d %d %d\n" % tuple(row) for row in ROWS.astype(int))


def test_numpy_never_parses_much_at_once(monkeypatch):
    """It lets no other thread run meanwhile, such as that of a service's event loop."""
    given: list[int] = []
    loadtxt = np.loadtxt

    def counted(file, *args, **kwargs):
        given.append(file.getbuffer().nbytes)
        return loadtxt(file, *args, **kwargs)

    monkeypatch.setattr(text_table.np, "loadtxt", counted)
    np.testing.assert_array_equal(parse_rows("text", TEXT), ROWS)
    assert sum(given) == len(TEXT) > 2 * PIECE_BYTES
    assert max(given) <= PIECE_BYTES + MAX_LINE_BYTES


@pytest.mark.filterwarnings("ignore:.*contained no data")  # NumPy's, of comments
@every_case("most", [0, 1, len(ROWS) - 1, len(ROWS), len(ROWS) + 1])
def test_later_rows_are_ignored(most):
    rows = parse_rows("text", TEXT, max_rows=most)
    np.testing.assert_array_equal(rows.reshape(-1, 4), ROWS[:most])
    with_comments = b"# no row\n" * (PIECE_BYTES // 4) + b"1 2 3\n"
    assert parse_rows("text", with_comments + b"4 5 6", comments="#", max_rows=1).tolist() == [[1, 2, 3]]


@every_case("odd", [b"1 2 3\n", b"1 2 3 4 5\n", b"1 2 x 4\n"])
def test_a_row_unlike_the_first_is_found_in_any_piece(odd):
    for text in (odd + TEXT, TEXT + odd, TEXT + odd + TEXT):
        with pytest.raises(MalformedData, match="text: "):
            parse_rows("text", text)
