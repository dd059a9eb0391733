"""Options of a build: the command line and the variables say all of them, at every level."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from firstfix.builds.options import BuildOptions
from firstfix.errors import InvalidOption


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
        ("dask://", "names no scheduler"),
        ("dask://scheduler", "names no scheduler"),
        ("dask://:8786", "names no scheduler"),
        ("dask://scheduler:0", "names no scheduler"),
        ("dask://scheduler:99999", "names no scheduler"),
        ("dask://scheduler:port", "names no scheduler"),
        ("dask://me@scheduler:8786", "without user, path or query"),
        ("dask://scheduler:8786/maps", "without user, path or query"),
        ("dask://scheduler:8786?workers=4", "without user, path or query"),
    ],
)
def test_anything_else_is_refused_with_a_reason(executor: str, said: str):
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
    samples_store="s3://samples",
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
def test_what_is_written_is_read(options: BuildOptions):
    assert BuildOptions.from_arguments(options.arguments(), options.environment()) == options


def test_every_option_differs_from_its_default_in_the_round_trip():
    plain = BuildOptions()
    same = [f.name for f in dataclasses.fields(ALL) if getattr(ALL, f.name) == getattr(plain, f.name)]
    assert same == []


def test_the_command_line_of_earlier_releases_is_read():
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


def test_a_command_of_an_earlier_release_reads_the_command_line():
    """An option that it does not know would end it: new options are variables."""
    known = {"--source-url", "--executor", "--no-provisional", "--store", "--build", "--work"}
    known |= {"--tied-to-stdin", "--share-stages", "--max-source-bytes", "--source-root"}
    assert {part for part in ALL.arguments() if part.startswith("--")} == known


def test_the_sandbox_has_neither_the_store_nor_the_network():
    inside = ALL.inside(provisional=True, traceparent=None)
    assert (inside.store, inside.source_urls, inside.source_roots) == ("", (), ())
    assert inside.scheduler is None
    assert inside.work == Path("/var/builds/build")
    assert (inside.build_id, inside.max_templates, inside.provisional) == ("b1", 9, True)
