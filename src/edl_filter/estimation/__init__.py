"""Generic estimation: linear-Gaussian state-space models, regression and parallel loops, with no application in it.

In and out: plain arrays, and models that consist of them. In: transition and measurement matrices, covariances,
measurements, rows of a regression. Out: white rows and likelihoods, smoothed states, posteriors of a regression.

Read in this order: `block_sparse` (matrices with one pattern of non-zero elements), `linear_state_space` (a linear
state-space model and those derived from it), `kalman` (the Kalman filter that whitens measurements under it, and one
Kalman update), `smoothing` (backward recursions: smoothed states, their covariance between steps, precision-weighted
residuals), `matern` (Matérn processes in state-space form), `regression` (Bayesian linear regression on white rows),
`autoregression` (interpolation of a missing stretch of a series, with its covariance), `gauss_markov` (a Gauss-Markov
process in white noise, in a stretch without observations), `interpolating_spline` (spline through values, or through
the integral of a series), `series` (finite rows, runs of a condition, moving means, interpolation of columns),
`small_matrices` (algebra for compiled loops), `random_fields` (correlation and realisations of smooth Gaussian
processes), `parallel` (threads for compiled loops, copies of the process for other computations).

References: Särkkä, Bayesian Filtering and Smoothing (2013); Durbin and Koopman, Time Series Analysis by State Space
Methods (2012); Gelman et al., Bayesian Data Analysis (2013).
"""
