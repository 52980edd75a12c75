"""Masses and inertias from joint logs, and the motion that excites them."""
