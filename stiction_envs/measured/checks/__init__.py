"""Defects of torque tables and joint logs."""
