"""Joint logs as signals of one bandwidth, against the nominal model."""
