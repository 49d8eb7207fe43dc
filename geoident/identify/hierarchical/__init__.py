"""Several sections of one ground: what they share, and how they scatter about it."""
