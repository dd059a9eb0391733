"""A version whose self-test is bad: the service goes on with the one before, and says why."""

from __future__ import annotations

import json
from pathlib import Path

from firstfix.builds.options import BuildOptions, ExitCode
from firstfix.catalog.manifest import Manifest
from firstfix_builder.job.build_job import BuildJob, BuildResult
from firstfix_builder.job.run_build import run_build
from firstfix_client import BuildStatus
from tests.service.builds_world import status_of, upload
from tests.service.service_world import Service, running_service
from tests.waiting import let_pass, wait_until


def built(service: Service, label: str, found: float, **config: object) -> dict[str, object]:
    """The status of a build of the map "hall", whose version answers x = label."""

    def build_version(job: BuildJob) -> BuildResult:
        directory = job.work / f"version-{label}"
        directory.mkdir(parents=True)
        (directory / "label.txt").write_text(label)
        tested = {"queries": 120, "found": found, "success": {"1m": found}}
        return BuildResult(directory, Manifest.for_directory(directory, self_test=tested))

    response = upload(service, **config)
    options = BuildOptions(
        store=service.settings.store,
        build_id=response.json()["build_id"],
        work=service.settings.work_dir / f"build-{label}",
        provisional=False,
    )
    assert run_build(options, build_version) is ExitCode.SUCCEEDED
    return status_of(service, response)


def served(service: Service) -> float:
    return service.ask_http().x


def test_the_service_goes_on_with_the_version_before(tmp_path: Path):
    with running_service(tmp_path, zenoh=False) as service:
        good = built(service, "1", 0.9)
        assert (good["activated"], good["findings"]) == (True, [])
        wait_until(lambda: service.http.get("/maps/hall").status_code == 200)
        assert served(service) == 1.0

        bad = built(service, "2", 0.3)
        assert bad["state"] == "succeeded"
        assert bad["activated"] is False
        (finding,) = bad["findings"]
        assert finding["code"] == "self_test_low"
        assert finding["numbers"] == {"found": 0.3, "least": 0.7}
        assert f"firstfix maps activate hall {bad['version']}" in finding["remedy"]
        assert BuildStatus.from_mapping("b", bad).findings[0].code == "self_test_low"
        events = service.http.get(f"/builds/{bad['build_id']}/events").text
        last = json.loads(events.rpartition("data: ")[2])
        assert last["findings"] == bad["findings"]
        let_pass(0.5)  # a few polls
        assert served(service) == 1.0
        versions = service.http.get("/maps/hall/versions").json()["versions"]
        assert {one["version"]: one["active"] for one in versions} == {
            good["version"]: True,
            bad["version"]: False,
        }

        assert service.http.post(f"/maps/hall/versions/{bad['version']}/activate").status_code == 200
        assert served(service) == 2.0, "a person decides otherwise"


def test_the_options_of_the_build_say_otherwise(tmp_path: Path):
    with running_service(tmp_path, zenoh=False) as service:
        assert built(service, "1", 0.3, activate={"min_found": 0.2})["activated"] is True
        wait_until(lambda: service.http.get("/maps/hall").status_code == 200)
        assert served(service) == 1.0
