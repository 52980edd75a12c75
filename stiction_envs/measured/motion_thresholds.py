"""When a measured joint rests, reverses or moves."""

REST_SPEED = 0.002
"""Below this speed a joint may rest: a filtered log shows neither that it moves nor where [rad/s].
Segments that never exceed it are poses; assumed."""
REVERSAL_SPEED = 0.01
"""A joint reverses between this speed and its opposite. Speeds that vary by less do not show lags
[rad/s]; assumed."""
STIR_SPAN = 0.01  # a joint that covers a smaller angle does not move at all [rad]; assumed
HOLD_SPAN = 0.02  # a joint that covers a smaller angle only holds its position [rad]; assumed
TRAVEL_SPAN = 0.05
"""Least angle that a joint must turn for its motion to be informative [rad]; assumed."""
START_SPAN = 0.0005
"""A joint that turns this far in its first `START_SAMPLES` moves from the start [rad]; assumed."""
START_SAMPLES = 10  # see `START_SPAN`; assumed
MOVER_RATIO = 0.2
"""A joint slower than this part of the fastest is only shaken by the others [-]; assumed."""
