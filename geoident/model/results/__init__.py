"""What the commands find: frozen data in SI units, as results keep it and reports show it."""
