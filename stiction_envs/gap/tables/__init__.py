"""Diagnosis of torque tables: errors of a simulation."""
