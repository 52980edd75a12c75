"""Gymnasium environments over `experiments`; the package registers them."""
