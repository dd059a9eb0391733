"""The suites of the scoreboard: how each is run, and the paths whose code decides its figures."""

from __future__ import annotations

from dataclasses import dataclass

ANSWERS = (  # what builds a map and answers a scan of it
    "native/include",
    "native/python",
    "core/firstfix/bit_exact",
    "core/firstfix/descriptor",
    "core/firstfix/engine",
    "core/firstfix/scan",
    "core/firstfix/sensor",
    "core/firstfix/transform.py",
    "builder/firstfix_builder/index",
    "builder/firstfix_builder/mesh",
    "builder/firstfix_builder/pipeline.py",
    "builder/firstfix_builder/self_test",
    "builder/firstfix_builder/simulation",
    "builder/firstfix_builder/templates",
    "builder/firstfix_builder/viewpoints",
)
ASKED = (  # what turns, asks and judges the scans
    "lab/firstfix_lab/common/asked.py",
    "tests/recorded_data.py",
    "lab/firstfix_lab/evaluation/outcome.py",
    "lab/firstfix_lab/evaluation/pose_gravity.py",
    "clients/python/firstfix_client/steps",
    "core/firstfix/wire",
)
BUILDS = (  # what else decides the work of a build
    "builder/firstfix_builder/build_stages.py",
    "builder/firstfix_builder/execution",
    "builder/firstfix_builder/rebuild",
    "builder/firstfix_builder/sources",
    "builder/firstfix_builder/stage_files.py",
    "builder/firstfix_builder/stage_results.py",
    "builder/firstfix_builder/tested_version.py",
)
WORLDS = ("cli/firstfix_cli/sample_world", "lab/firstfix_lab/worlds")
SERVICE = ("service/firstfix_service", "clients/python/firstfix_client", "core/firstfix/wire")


@dataclass(frozen=True)
class Suite:
    """A suite and its result.

    Attributes:
        name: of the suite and of its result's file.
        arguments: of ``firstfix-lab``, for the whole run.
        quick: arguments of a small run; None: there is none.
        measured: files and folders whose code decides the figures that pages show.
        cases: CSV file with one row a case, which the run leaves; empty: the figures hold all that there is.
        module: is run by ``python -m``.
        json_option: the suite writes its figures to a file; else they are the lines that it prints.
    """

    name: str
    arguments: tuple[str, ...]
    quick: tuple[str, ...] | None
    measured: tuple[str, ...]
    cases: str = ""
    json_option: bool = True
    module: str = "firstfix_lab"


def _of_run(name: str, measured: tuple[str, ...], cases: str = "") -> Suite:
    own = (f"lab/firstfix_lab/suites/{name}", *measured)
    return Suite(name, (name,), (name, "--quick"), own, cases)


SUITES = {
    suite.name: suite
    for suite in (
        _of_run("real", (*ANSWERS, *ASKED), "build/bench/real/answers.csv"),
        _of_run("robust", (*ANSWERS, *WORLDS), "build/bench/robust/outcomes.csv"),
        _of_run("peers", (*ANSWERS, *ASKED)),
        _of_run("paper", (*ANSWERS, *WORLDS)),
        _of_run("service", (*ANSWERS, *SERVICE)),
        _of_run("scale", (*ANSWERS, *WORLDS)),
        _of_run("rebuilds", (*ANSWERS, *BUILDS, "lab/firstfix_lab/suites/beside/run_build.py", *WORLDS)),
        _of_run("ablation", (*ANSWERS, *ASKED, *WORLDS)),
        Suite(
            "ros",
            ("ros",),
            None,
            ("tests/robots", "plugins/fleet", "clients/ros2"),
            json_option=False,
        ),
    )
}
