"""Non-linear least squares on factor graphs: compile, initialise, optimise, covariance, diagnosis."""
