"""What a case says: frozen data in SI units, without files and without algorithms."""
