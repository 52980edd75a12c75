"""The judge: names causes by one number, the log evidence of a model with proper priors."""
