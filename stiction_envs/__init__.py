"""Robot joints that stick in MuJoCo, and the dither that frees them."""
