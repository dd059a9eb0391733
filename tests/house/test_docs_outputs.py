"""What the tutorials print is what their commands print."""

from __future__ import annotations

import importlib.util
import re
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.every_case import every_case

REPO = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("docs_outputs", REPO / "scripts/docs_outputs.py")
assert spec is not None
assert spec.loader is not None
docs_outputs = importlib.util.module_from_spec(spec)
sys.modules[spec.name] = docs_outputs
spec.loader.exec_module(docs_outputs)
PAGES = [page for tutorial in docs_outputs.TUTORIALS for page in tutorial]


@every_case("page", PAGES)
def test_every_output_of_a_tutorial_is_of_a_block_that_is_run(page):
    text = (REPO / page).read_text()
    blocks = list(docs_outputs.blocks_of(text))
    marks = len(re.findall(r"(?m)^ *<!-- (?:run|serve)", text))
    assert len(blocks) == marks, "each mark stands before a block"
    printed = len(re.findall(r"(?m)^ *```\n\n *```text$", text))
    assert len([block for block in blocks if block.output is not None]) == printed


def test_the_small_outputs_are_what_the_commands_print(tmp_path: Path):
    """Those that take seconds; ``make docs-outputs`` makes all of them anew."""
    for pages in docs_outputs.TUTORIALS:
        for page in pages:
            text = (REPO / page).read_text()
            with ExitStack() as services:
                assert docs_outputs.with_outputs(text, tmp_path, services, small=True) == text, page
    assert (tmp_path / "world").is_dir(), "they were run"


PAGE = """Text.

<!-- run -->
```sh
echo 1 > made; echo old news; echo '  ms  7'
```

```text
stale
```

* In a list:

    <!-- run, small -->
    ```python
    print(open("made").read().strip())
    print()
    print("x")
    ```

    ```text
    2
    ```

```sh
exit 7
```

```text
kept
```
"""


def test_outputs_are_written_in_place(tmp_path: Path):
    with ExitStack() as services:
        made = docs_outputs.with_outputs(PAGE, tmp_path, services)
        small = docs_outputs.with_outputs(PAGE, tmp_path, services, small=True)
    assert made == PAGE.replace("stale", "old news").replace("    2\n", "    1\n\n    x\n")
    assert small == PAGE.replace("    2\n", "    1\n\n    x\n")


def test_a_command_that_fails_is_an_error(tmp_path: Path):
    page = PAGE.replace("echo 1 > made", "echo gone >&2; exit 2")
    with ExitStack() as services, pytest.raises(RuntimeError, match="gone"):
        docs_outputs.with_outputs(page, tmp_path, services)
