"""The page of a notebook, as it was saved: words, code, and what the code printed and drew."""

import base64
import json
from pathlib import Path
from typing import Any

TITLE = "# @title"
"""Begins a cell that Colab shows by its title only; pages leave it out."""


def notebook_page(source: Path, out: Path) -> str:
    """Return a notebook as Markdown; write its pictures beside the page ``out``."""
    notebook = json.loads(source.read_text(encoding="utf-8"))
    parts, pictures = [], 0
    for cell in notebook["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
            continue
        if text.startswith(TITLE):
            continue
        parts.append(f"```python\n{text}\n```")
        for output in cell["outputs"]:
            if "text" in output:
                printed = "".join(output["text"]).rstrip()
                parts.append(f"```text\n{printed}\n```")
            if picture := _picture(output):
                pictures += 1
                name = f"{out.stem}_{pictures}.png"
                (out.parent / name).write_bytes(picture)
                parts.append(f"![]({name})")
    return "\n\n".join(parts) + "\n"


def _picture(output: dict[str, Any]) -> bytes:
    """Return what a cell drew, or nothing."""
    return base64.b64decode("".join(output.get("data", {}).get("image/png", "")))
