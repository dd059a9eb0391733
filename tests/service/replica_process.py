"""A service in a process of its own, which tests can kill; its localizers are fakes.

Settings come from the environment. ``FAKE_SECONDS``: time that a query takes.
"""

from __future__ import annotations

import os

from firstfix_service.app import create_app
from firstfix_service.server import Server
from firstfix_service.settings import Settings
from tests.service.service_world import Behaviour
from tests.waiting import let_pass


class Gate:
    """An event that sets itself."""

    def wait(self, timeout: float) -> bool:
        let_pass(float(os.environ.get("FAKE_SECONDS", "0")))
        return True


def main() -> None:
    settings = Settings()
    behaviour = Behaviour(gate=Gate())  # type: ignore[arg-type]
    Server(create_app(settings, load=behaviour.load), settings).run()


if __name__ == "__main__":
    main()
