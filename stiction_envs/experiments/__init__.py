"""Protocols of the thesis, and what is identified with them."""
