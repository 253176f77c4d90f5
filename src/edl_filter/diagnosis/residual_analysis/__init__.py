"""Residual analysis: where a model fails, what is left, and what the flight says of its nuisance parameters.

In: a `LinearizedModel`. Out: residual map, change points, unmodelled force, unexplained remainder, increments of the
database, and nuisance parameters that moved.

Read in this order, on the innovations: `residual_map` (channels, their residuals against time, and their RMS over the
flight and in every flight regime), `change_point` (when channels begin to fail), `unexplained` (unmodelled force and
moment against time, and what they follow). On the posterior: `field_posterior` and `database_update`
(increments of the tables), `nuisance_shifts` (parameters that moved).
"""
