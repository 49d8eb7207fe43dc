"""One mesh, one moment: elements, operators, point location, sparse factorization."""
