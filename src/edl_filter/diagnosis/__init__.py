"""Diagnosis: where a model fails, which physical effect is missing, and what is left.

In: a reconstructed flight with its mission (`FlightCase`), and candidate effects. Out: a `Diagnosis`. The steps, one
package each, in this order:

`prediction`
    What the model says that every instrument should have read, and the residuals.
`jacobians`
    Derivatives of the residuals with respect to everything that is uncertain, as a linear state-space model.
`noise`
    Noise and accelerations beyond those stated, by marginal likelihood.
`linear_model`
    Residuals, Jacobians and noise about one linearisation point; derivatives with respect to an effect.
`residual_analysis`
    Residual map, change points, residuals against time, unmodelled force, unexplained remainder.
`selection`
    Screening, fits, evidence, probabilities and verdict.

Then `diagnosis` joins them; `state` states the result in sentences; `stepwise` repeats diagnosis and fit (forward
selection); `detectability` computes how large an effect must be to be named on a flight.
"""
