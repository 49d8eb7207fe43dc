"""Several sections in pictures."""
