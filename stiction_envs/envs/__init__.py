"""Gymnasium environments: thin skins over `experiments`; the package registers them."""
