"""Engines that step N simulations of one model: MuJoCo itself, and MuJoCo Warp."""
