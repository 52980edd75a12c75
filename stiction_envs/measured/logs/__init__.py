"""Joint logs of real robots: read, checked, corrected, and every correction written down."""
