"""The thesis's protocol: base torques in, final amplitude table out."""
