"""Measurement models: one file a model, with residual, analytic Jacobian and formula."""
