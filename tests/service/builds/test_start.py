"""Options of builds, as the settings say."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from firstfix.builds.limits import memory_bytes
from firstfix_service.builds.process import build_options
from firstfix_service.settings import Settings


def test_a_builds_process_hears_of_the_cluster():
    here = Settings(store="s3://maps")
    there = Settings(store="s3://maps", build_executor="dask://scheduler:8786")
    assert "--executor" not in build_options(here).arguments()
    assert build_options(there).scheduler == "tcp://scheduler:8786"


def test_with_a_cluster_stages_are_in_the_store():
    assert not build_options(Settings(store="s3://maps")).share_stages
    clustered = {"build_executor": "dask+tls://scheduler:8786", "shared_stages_max_bytes": 0}
    assert build_options(Settings(store="s3://maps", **clustered)).share_stages


@pytest.mark.parametrize(
    "executor",
    ["dask", "dask://", "dask://host", "tcp://host:8786", "dask://me@host:8786", "dask://h:8786/x"],
)
def test_an_executor_that_is_none_is_refused_at_the_start(executor: str):
    with pytest.raises(ValidationError, match="build_executor"):
        Settings(store="s3://maps", build_executor=executor)


def test_a_build_is_told_of_its_sandbox_and_its_memory():
    plain = build_options(Settings(store="memory://")).environment()
    assert plain["FIRSTFIX_BUILD_SANDBOX"] == "auto"
    assert plain["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] == str(memory_bytes() // 2)
    assert plain["FIRSTFIX_BUILD_MAX_TEMPLATES"] == "4000000"
    limited = Settings(store="memory://", build_sandbox="required", build_max_memory_bytes=1 << 30)
    told = build_options(limited).environment()
    assert told["FIRSTFIX_BUILD_SANDBOX"] == "required"
    assert told["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] == str(1 << 30)
    unlimited = build_options(Settings(store="memory://", build_max_memory_bytes=0))
    assert unlimited.max_memory_bytes is None
    assert unlimited.environment()["FIRSTFIX_BUILD_MAX_MEMORY_BYTES"] == "0"
