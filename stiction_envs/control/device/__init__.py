"""Controllers on Warp's device, beside the arms that they control (extra ``warp``)."""
