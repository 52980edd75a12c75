"""Table 4.11 under many set-ups that the thesis does not rule out."""
