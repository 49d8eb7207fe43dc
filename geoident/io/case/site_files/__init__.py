"""Files of readings as a case declares them, and what went where."""
