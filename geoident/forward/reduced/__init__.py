"""A certified reduced model of the elastic march (theory 14)."""
