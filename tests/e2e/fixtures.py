"""Start of many end-to-end tests: the localizer of the small world's version."""

from __future__ import annotations

import pytest

from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.descriptor_parameters import DescriptorParameters


@pytest.fixture(scope="session")
def index(small_version) -> MapIndex:
    return MapIndex.load(small_version.directory)


@pytest.fixture(scope="session")
def localizer(index) -> Localizer:
    return Localizer(index)


@pytest.fixture(scope="session")
def parameters(small_version) -> DescriptorParameters:
    """Of the descriptors of the small world's version, as a robot gets them."""
    return DescriptorParameters.from_engine(small_version.manifest.engine)
