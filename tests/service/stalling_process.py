"""A service in a process of its own, as ``firstfix serve`` runs it, that can be made to stand still.

GET /stall/{seconds} blocks the event loop for that long. Settings come from the environment. With
``FAKE_GATE`` its localizers are fakes, which wait for the file of that name and then answer with megabytes.
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
from fastapi import Request, Response

from firstfix.answer.localization import Hypothesis, Localization, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix_service import server
from firstfix_service.settings import Settings
from tests.service.service_world import Behaviour, FakeLocalizer
from tests.waiting import let_pass, wait_until

MANY = 20_000  # hypotheses: more bytes than the buffers between two processes hold
_create_app = server.create_app


class Gate:
    """An event that is set by a file."""

    def wait(self, timeout: float) -> bool:
        wait_until(Path(os.environ["FAKE_GATE"]).exists)
        return True


class Talkative(Behaviour):
    """Answers with megabytes if the scan has 100 points; shortly otherwise."""

    def load(self, directory: Path) -> FakeLocalizer:
        return TalkativeLocalizer(1.0, self)


class TalkativeLocalizer(FakeLocalizer):
    def localize(self, scan, options=None, *_: object) -> Localization:
        if len(scan) != 100:
            return FakeLocalizer(self.label, Behaviour()).localize(scan, options)
        answer = super().localize(scan, options)
        many = (Hypothesis(np.eye(4), AlignmentQuality(0.9, 0.8, 0.01), 0.9, 7),) * MANY
        return dataclasses.replace(answer, verdict=Verdict.LOCALIZED, hypotheses=many)


def create_stalling_app(settings: Settings):
    app = _create_app(settings, load=Talkative(gate=Gate()).load if "FAKE_GATE" in os.environ else None)

    async def stall(request: Request) -> Response:
        let_pass(float(request.path_params["seconds"]))
        return Response()

    app.router.add_route("/stall/{seconds}", stall)
    return app


if __name__ == "__main__":
    server.create_app = create_stalling_app
    server.serve(Settings())
