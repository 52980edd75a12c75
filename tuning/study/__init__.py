"""Studies: where trials are kept, and how they are filled, by one process or by many machines."""
