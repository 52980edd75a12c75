"""Outside torques on the arm: springs, cables, hoses; one file per cause."""
