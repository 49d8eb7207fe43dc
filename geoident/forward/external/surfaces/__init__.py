"""Response surfaces through runs that were made elsewhere, and their own errors (theory 4.8)."""
