"""Results as one self-contained page with figures."""
