"""Block-sparse patterns, elimination ordering, Cholesky factor, selected inverse."""
