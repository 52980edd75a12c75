"""Hides each cause in the motion of a user's own log: what would a diagnosis find there?"""
