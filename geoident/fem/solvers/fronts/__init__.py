"""Our own sparse Cholesky factorization: the multifrontal method (Duff & Reid 1983, Liu 1992)."""
