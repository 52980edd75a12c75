"""From joint logs to named causes: what the simulation gets wrong, and the evidence."""
