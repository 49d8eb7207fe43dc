"""Numbers of the ground that follow from others by experience."""
