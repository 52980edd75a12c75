"""A third experiment, as small as one can be: how still does dither leave an arm that is held?"""
