"""Dither: waveforms, their application to many joints at once, gating by speed."""
