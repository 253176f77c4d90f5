"""Residual analysis: where a model fails, what is left, and what the flight says of its nuisance parameters.

On the innovations of a linearised model: `channel_rms` (names and units of the channels, normalised innovations and
their RMS), `residual_map` (every channel in every flight regime, and change points), `time_series` (residuals against
time), `latent_force` (unmodelled force and moment against time), `unexplained` (what they follow), `run_residuals` (the
same for a reconstruction that is not diagnosed). On its posterior: `field_posterior` and `database_update` (increments
of the tables), `cross_prediction` (how well they predict another flight), `nuisance_shifts` (parameters that moved).
"""
