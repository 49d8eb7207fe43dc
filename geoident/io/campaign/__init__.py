"""Campaign files: one case in many variations."""
