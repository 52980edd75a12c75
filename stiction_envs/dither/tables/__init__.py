"""Final amplitude tables of ``stiction tune ROBOT`` with the shipped friction."""

from pathlib import Path

HERE = Path(__file__).parent


def shipped_table(arm: str | None, ending: str = "") -> Path | None:
    """Return the table that is shipped for an arm by its name, None if there is none."""
    path = HERE / f"{arm}{ending}.csv"
    return path if path.is_file() else None
