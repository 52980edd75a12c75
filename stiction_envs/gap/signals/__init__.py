"""Joint logs as signals of one bandwidth, beside the nominal model."""
