"""Jacobians: derivatives of the residuals with respect to everything that is uncertain, as a linear state-space model.

In: residuals about a linearisation point, and the stated uncertainties. Out: a `LinearStateSpace` whose states are the
errors of navigation and sensors and the nuisance parameters of air, database and vehicle. Read in this order:
`nuisance` (which states there are), `transitions` (how the navigation errors propagate), `denoised_readings`,
`coefficient_errors` (of tables and prediction), `prediction_jacobian` (derivatives of the predictions), `bin_rows`
(measurement rows of the bins), `state_space` (all of it in the order of time).
"""
