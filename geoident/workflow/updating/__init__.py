"""Results brought up to date as readings come: ``update``, and ``watch``, which runs it."""
