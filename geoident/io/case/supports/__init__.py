"""The key ``supports``: what is held, and how it moves."""
