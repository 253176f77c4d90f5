"""Prediction: what the model says that every instrument should have read, and the residuals.

In: the filter problem and the forward model of a mission, a linearisation point. Out: measured minus predicted specific
force, rate steps, readings of the checking IMUs, and constraints. Read in this order: `time_bins`, `dead_reckoning`
(the path along which both are compared), `predicted_readings`, `interpolation_error` (of lever-arm accelerations, of
rates that are shifted in time, and of attitudes inside a bin), `residuals` (with their order in the residual vector),
`reading_difference` (derivative with respect to a sensor error).
"""
