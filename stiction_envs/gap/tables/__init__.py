"""What a simulation gets wrong, told from tables of breakaway torques."""
