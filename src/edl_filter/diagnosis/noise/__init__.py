"""Noise: what the residuals contain beyond the stated uncertainties, estimated by marginal likelihood.

In: residuals and their state-space model. Out: excess variance, and an unmodelled acceleration. Read in this order:
`variance_components` (additional variance of every channel over intervals of time), `excess_colour` (its correlation in
time), `unmodelled_acceleration` (a force and a moment that follow no named effect, as a Gauss–Markov process).
"""
