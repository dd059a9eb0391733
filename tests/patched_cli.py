"""The command line with other constants of the service: ``CONSTANTS='{"build_attempts": 1000}'``."""

import json
import os

from firstfix_cli.main import run
from tests.service.changed_constants import changed_constants

if __name__ == "__main__":
    with changed_constants(json.loads(os.environ["CONSTANTS"])):
        run()
