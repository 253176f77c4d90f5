"""Residual analysis: where a model fails, what is left, and what the flight says of its nuisance parameters.

On the innovations of a linearised model: `normalised_residuals` (channels, their residuals against time, and the RMS),
`residual_map` (every channel in every flight regime, and change points), `latent_force` (unmodelled force and moment
against time), `unexplained` (what they follow). On its posterior: `field_posterior` and `database_update` (increments
of the tables), `cross_prediction` (how well they predict another flight), `nuisance_shifts` (parameters that moved).
"""
