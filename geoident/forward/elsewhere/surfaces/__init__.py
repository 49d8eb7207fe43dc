"""Response surfaces through runs that were made elsewhere, and what they do not know (theory 4.8)."""
