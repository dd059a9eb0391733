"""Configs, options and limits of builds: what is read, what is refused, and the defaults."""

from __future__ import annotations

import dataclasses
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.builds.config import BuildConfig
from firstfix.builds.limits import default_build_memory_bytes, memory_bytes
from firstfix.builds.options import BuildOptions
from firstfix.errors import InvalidOption

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)
FIELDS = list(BuildConfig.model_fields)


def test_an_empty_config_is_the_default():
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
def test_an_invalid_value_is_named_by_its_path(data: Any, says: str):
    with pytest.raises(InvalidOption, match=says):
        BuildConfig.parse(data)


@given(JSON | st.dictionaries(st.sampled_from(FIELDS), JSON))
def test_any_value_is_a_config_or_refused(data: Any):
    with suppress(InvalidOption):
        assert isinstance(BuildConfig.parse(data), BuildConfig)


@pytest.mark.parametrize(
    ("executor", "address"),
    [
        ("threads", None),
        ("dask://scheduler:8786", "tcp://scheduler:8786"),
        ("dask://10.0.0.7:8786/", "tcp://10.0.0.7:8786"),
        ("dask://[fd00::7]:8786", "tcp://[fd00::7]:8786"),
        ("dask+tls://scheduler.maps.svc:8786", "tls://scheduler.maps.svc:8786"),
    ],
)
def test_an_executor_is_threads_or_a_scheduler(executor: str, address: str | None):
    assert BuildOptions(executor=executor).scheduler == address


@pytest.mark.parametrize(
    ("executor", "said"),
    [
        ("", "no executor"),
        ("thread", "no executor 'thread'"),
        ("tcp://scheduler:8786", "dask://HOST:PORT"),
        *((f"dask://{rest}", "names no scheduler") for rest in ("", "scheduler", ":8786")),
        *((f"dask://scheduler:{port}", "names no scheduler") for port in ("0", "99999", "port")),
        *(
            (f"dask://{rest}", "without user, path or query")
            for rest in ("me@scheduler:8786", "scheduler:8786/maps", "scheduler:8786?workers=4")
        ),
    ],
)
def test_an_invalid_executor_is_refused_with_a_reason(executor: str, said: str):
    with pytest.raises(InvalidOption) as caught:
        _ = BuildOptions(executor=executor).scheduler
    assert said in str(caught.value)


ALL = BuildOptions(
    build_id="b1",
    store="s3://maps",
    work=Path("/var/builds"),
    executor="dask://scheduler:8786",
    sandbox="required",
    max_memory_bytes=1 << 30,
    max_templates=9,
    max_source_bytes=10,
    recorded_store="s3://recorded-queries",
    source_urls=("https://a/", "https://b/"),
    source_roots=(Path("/maps"), Path("/more maps")),
    share_stages=True,
    provisional=False,
    tied_to_stdin=True,
    log_level="debug",
    log_json=True,
    traceparent="00-" + "1" * 32 + "-" + "2" * 16 + "-01",
)


@pytest.mark.parametrize("options", [BuildOptions(), ALL, BuildOptions(max_templates=None)])
def test_options_are_read_from_their_command_line(options: BuildOptions):
    assert BuildOptions.from_arguments(options.arguments(), options.environment()) == options


def test_every_option_differs_from_its_default_in_the_round_trip():
    plain = BuildOptions()
    same = [f.name for f in dataclasses.fields(ALL) if getattr(ALL, f.name) == getattr(plain, f.name)]
    assert same == []


def test_a_command_line_is_read():
    line = "--source-url https://a/ --executor dask://h:1 --no-provisional --store s --build b --work w"
    read = BuildOptions.from_arguments([*line.split(), "--tied-to-stdin", "--share-stages"], {})
    assert read == BuildOptions(
        source_urls=("https://a/",),
        executor="dask://h:1",
        provisional=False,
        store="s",
        build_id="b",
        work=Path("w"),
        tied_to_stdin=True,
        share_stages=True,
    )
    odd = "--store s --build b --work w --max-source-bytes 3 --source-root /maps --sandbox off"
    told = {"FIRSTFIX_BUILD_SANDBOX": "required"}
    read = BuildOptions.from_arguments(odd.split(), told)
    assert (read.max_source_bytes, read.source_roots, read.sandbox) == (3, (Path("/maps"),), "off")


def test_the_sandbox_has_neither_the_store_nor_the_network():
    inside = ALL.inside(provisional=True, traceparent=None)
    assert (inside.store, inside.source_urls, inside.source_roots) == ("", (), ())
    assert inside.scheduler is None
    assert inside.work == Path("/var/builds/build")
    assert (inside.build_id, inside.max_templates, inside.provisional) == ("b1", 9, True)


MACHINE = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def cgroups(folder: Path, files: dict[str, str], of_this_process: str) -> tuple[Path, Path]:
    for name, content in files.items():
        path = folder / "cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    (folder / "self").write_text(of_this_process)
    return folder / "cgroup", folder / "self"


@pytest.mark.parametrize(
    ("files", "of_this_process", "found"),
    [
        ({"memory.max": "1000\n"}, "0::/\n", 1000),
        ({"memory.max": "max\n"}, "0::/\n", MACHINE),
        ({"memory.max": str(1 << 62)}, "0::/\n", MACHINE),
        ({"a/b/memory.max": "3000", "a/memory.max": "2000"}, "0::/a/b\n", 2000),
        ({"a/memory.max": "2000"}, "0::/elsewhere\n", MACHINE),
        ({"memory/memory.limit_in_bytes": "5000\n"}, "4:memory:/docker/1\n", 5000),
        ({}, "", MACHINE),
    ],
)
def test_the_memory_is_that_of_the_machine_or_of_the_container(tmp_path, files, of_this_process, found):
    assert memory_bytes(*cgroups(tmp_path, files, of_this_process)) == found
    assert memory_bytes(tmp_path / "none", tmp_path / "none") == MACHINE, "without cgroups"
    assert default_build_memory_bytes() == memory_bytes() // 2
