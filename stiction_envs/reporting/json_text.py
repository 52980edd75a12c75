"""Standard JSON: paths as text, numbers as Python's, null for what is not finite."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stiction_envs.reporting.atomic import write_text_atomic

JsonRecord = Mapping[str, Any]
"""JSON values by name, to be read; the reader knows the types."""


def plain(value: object) -> Any:
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


def to_text(value: object) -> str:
    """Return indented JSON of `plain` values."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write JSON with a line end."""
    write_text_atomic(path, to_text(value) + "\n")
