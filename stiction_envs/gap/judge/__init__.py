"""The judge: one model of the error, one evidence, one search for causes."""
