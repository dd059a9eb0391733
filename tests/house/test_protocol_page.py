"""The protocol's pages name what there is to name."""

from pathlib import Path

import pytest

from firstfix.answer.localization import Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.atan2 import COEFFICIENTS
from firstfix.errors import all_errors
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence

CLIENTS = Path(__file__).resolve().parents[2] / "clients"
PAGE = (CLIENTS / "PROTOCOL.md").read_text()


@pytest.mark.parametrize(
    "name",
    [
        *sorted(error.code for error in all_errors()),
        *LocalizeOptions.__dataclass_fields__,
        *(item.value for item in (*Reason, *Verdict)),
        *(module.MEDIA_TYPE for module in (wire, wire_query, wire_sequence)),
    ],
)
def test_the_page_names_it(name: str):
    assert f"`{name}`" in PAGE


def test_the_arctangent_is_the_one_that_is_computed():
    page = (CLIENTS / "protocol" / "on-the-robot.md").read_text()
    header = (CLIENTS.parent / "native" / "include" / "firstfix" / "bit_exact" / "atan2.hpp").read_text()
    for coefficient in map(str, COEFFICIENTS):
        assert coefficient in page
        assert f"{coefficient}F" in header
