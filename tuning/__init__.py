"""The dither tuner: from measured base torques to a final amplitude table."""
