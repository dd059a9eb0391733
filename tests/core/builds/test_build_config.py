from __future__ import annotations

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.builds.config import BuildConfig
from firstfix.errors import InvalidOption

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)
FIELDS = list(BuildConfig.model_fields)


def test_nothing_given_is_a_config():
    assert BuildConfig.parse({}) == BuildConfig()
    assert BuildConfig.parse(BuildConfig().to_mapping()) == BuildConfig()


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ({"spacing": 1}, r"build config: spacing: there is no such option"),
        ({"viewpoints": {"spacing_m": 0}}, r"viewpoints\.spacing_m: .*at least 0\.1"),
        ({"self_test": {"perturb": {"dropout": "much"}}}, r"self_test\.perturb\.dropout: .*valid number"),
        ({"self_test": {"max_false_accept": 0}}, r"self_test\.max_false_accept: .*greater than 0"),
        ({"self_test": {"max_false_accept": 0.2}}, r"self_test\.max_false_accept: .*at most 0\.1"),
        ({"engine": {"method": "magic"}}, r"engine\.method: .*'default' or 'paper'"),
        ({"engine": {"descriptor": {"kind": "x"}}}, r"engine\.descriptor: .*'occupancy', 'pca_sc'"),
        ({"sensor": "vlp-17"}, r"sensor: .*no sensor preset 'vlp-17'"),
        ({"sensor": {"preset": "vlp-16", "beams": 3}}, r"sensor: .*beams"),
        ({"sensor": {"preset": "vlp-16", "min_range_m": "a"}}, "sensor"),
        ({"activate": {"min_localized": 0.5}}, r"activate: min_localized is min_found now: .*whose place"),
        ([], "build config"),
    ],
)
def test_what_cannot_be_used_is_named_by_its_path(data: Any, says: str):
    with pytest.raises(InvalidOption, match=says):
        BuildConfig.parse(data)


@given(JSON | st.dictionaries(st.sampled_from(FIELDS), JSON))
def test_whatever_comes_is_a_config_or_refused(data: Any):
    with suppress(InvalidOption):
        assert isinstance(BuildConfig.parse(data), BuildConfig)
