"""Executed notebooks as pages: their text, code and stored outputs."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any


def notebook_files(notebook: Path) -> dict[str, str | bytes]:
    """The page of a notebook and the pictures in it, by their places on the site."""
    cells = json.loads(notebook.read_text())["cells"]
    folder, files, parts = f"notebooks/{notebook.stem}", {}, []
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            if picture := output.get("data", {}).get("image/png"):
                name = f"output-{len(files) + 1}.png"
                files[f"{folder}/{name}"] = base64.b64decode(picture)
                parts.append(f"![Output of the cell above]({notebook.stem}/{name})")
            elif text := _text(output):
                parts.append(f"```text\n{text.rstrip()}\n```")
    parts.append(f"[Download this notebook]({notebook.name})")
    return {f"{folder}.md": "\n\n".join(parts) + "\n", **files}


def _text(output: dict[str, Any]) -> str:
    return "".join(output.get("text") or output.get("data", {}).get("text/plain") or "")
