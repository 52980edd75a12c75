"""Files of a diagnosis over time for other people's viewers: Rerun, Foxglove, PlotJuggler."""
