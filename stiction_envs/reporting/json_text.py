"""Standard JSON: paths as text, numbers as Python's, null for what is not finite."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

from stiction_envs.reporting.atomic import write_text_atomic


def plain(value: Any) -> Any:
    """Return JSON values: paths as text, numbers as Python's, what is not finite as None."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def to_text(value: Any) -> str:
    """Return indented JSON of `plain` values."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Write JSON with a line end."""
    write_text_atomic(path, to_text(value) + "\n")
