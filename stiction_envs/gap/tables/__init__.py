"""What a simulation gets wrong, found in tables of breakaway torques."""
