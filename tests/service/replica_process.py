"""A firstfix service in a process of its own that may be killed; its localizers are the tests' fakes.

Settings come from the environment. ``FAKE_SECONDS``: how long a query takes.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # pytest has it there, this process of its own has not

from service_world import Behaviour

from firstfix_service.app import create_app
from firstfix_service.server import Server
from firstfix_service.settings import Settings


class Gate:
    """Opens by itself."""

    def wait(self, timeout: float) -> bool:
        time.sleep(float(os.environ.get("FAKE_SECONDS", "0")))
        return True


def main() -> None:
    settings = Settings()
    behaviour = Behaviour(gate=Gate())  # type: ignore[arg-type]
    Server(create_app(settings, load=behaviour.load), settings).run()


if __name__ == "__main__":
    main()
