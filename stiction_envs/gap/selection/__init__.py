"""Which causes are in a model: candidates, their gain, the search, and models as a whole."""
