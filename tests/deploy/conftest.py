from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.deploy.engine import running_engine


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with running_engine(tmp_path_factory.mktemp("engine") / "dockerd.log"):
        yield
