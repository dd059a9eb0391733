"""How builds are started, as the settings say."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from firstfix_service.settings import Settings
from firstfix_service.start_builds import build_command


def test_a_builds_process_hears_of_the_cluster():
    here = Settings(store="s3://maps")
    there = Settings(store="s3://maps", build_executor="dask://scheduler:8786")
    assert "--executor" not in build_command(here).command
    assert build_command(there).command[-2:] == ("--executor", "dask://scheduler:8786")


def test_with_a_cluster_stages_are_in_the_store():
    assert not Settings(store="s3://maps").stages_are_shared
    clustered = Settings(store="s3://maps", build_executor="dask+tls://scheduler:8786", share_stages=False)
    assert clustered.stages_are_shared
    assert build_command(clustered).share_stages


@pytest.mark.parametrize(
    "executor",
    ["dask", "dask://", "dask://host", "tcp://host:8786", "dask://me@host:8786", "dask://h:8786/x"],
)
def test_an_executor_that_is_none_is_refused_at_the_start(executor: str):
    with pytest.raises(ValidationError, match="build_executor"):
        Settings(store="s3://maps", build_executor=executor)
