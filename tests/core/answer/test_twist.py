"""The motion during a scan as an option and in an answer."""

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.errors import InvalidOption

TWIST = np.array([1.0, -0.25, 0.0, 0.0, 1e-3, 0.7])


def test_an_option_survives_its_text():
    text = LocalizeOptions(twist=TWIST).to_strings()
    assert text == {"twist": "1.0,-0.25,0.0,0.0,0.001,0.7"}
    assert np.array_equal(LocalizeOptions.from_strings(text).twist, TWIST)
    assert LocalizeOptions.from_strings({}).twist is None


@pytest.mark.parametrize(
    "text", ["", "1,2,3", "1,2,3,4,5", "1,2,3,4,5,x", "101,0,0,0,0,0", "0,0,0,0,0,-21", "nan,0,0,0,0,0"]
)
def test_a_twist_of_another_form_or_size_is_refused(text):
    with pytest.raises(InvalidOption, match="twist"):
        LocalizeOptions.from_strings({"twist": text})


def test_an_answer_survives_its_json():
    answer = Localization(Verdict.LOCALIZED, T_map_sensor=np.eye(4), twist=TWIST)
    sent = answer.to_mapping()
    assert sent["twist"] == {"linear": [1.0, -0.25, 0.0], "angular": [0.0, 0.001, 0.7]}
    assert np.array_equal(Localization.from_mapping(sent).twist, TWIST)
    rejected = Localization(Verdict.REJECTED).to_mapping()
    assert rejected["twist"] is None
    del rejected["twist"]  # as a service before this one
    assert Localization.from_mapping(rejected).twist is None
