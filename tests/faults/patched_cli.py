"""The command line with other constants of the service: ``CONSTANTS='{"build_attempts": 1000}'``."""

import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "service"))

from changed_constants import changed_constants

from firstfix_cli.main import run

if __name__ == "__main__":
    with changed_constants(json.loads(os.environ["CONSTANTS"])):
        run()
