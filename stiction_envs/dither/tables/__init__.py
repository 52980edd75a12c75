"""Final amplitude tables of ``stiction tune ROBOT`` with the shipped friction."""

from pathlib import Path

HERE = Path(__file__).parent
