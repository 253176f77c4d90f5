"""Residual analysis: where a model fails, what is left, and what the flight says of its nuisance parameters.

On the innovations of a linearised model: `residual_map` (channels, their residuals against time, and their RMS over the
flight and in every flight regime), `change_point` (when channels begin to fail), `latent_force` (unmodelled force and
moment against time), `unexplained` (what they follow). On its posterior: `field_posterior` and `database_update`
(increments of the tables), `cross_prediction` (how well they predict another flight), `nuisance_shifts` (parameters
that moved).
"""
