"""The command line of the tuner: `stiction` finds these modules by their entry points."""
