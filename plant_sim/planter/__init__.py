"""Chain planter of the cabbage paper: parameters, motion and points of zero horizontal speed."""
