"""Noise: what the residuals contain beyond the stated uncertainties, estimated by marginal likelihood.

`variance_components` estimates additional variance of every channel over intervals of time; `unmodelled_acceleration`
a force and moment that follow no named effect, as a Gauss–Markov process.
"""
