"""The linear model: residuals, Jacobians and noise about one linearisation point.

`flight_case` holds what does not change while a flight is diagnosed; `linearization_point` says about which state, air
and vehicle the model is linear; `linear_model` holds residuals, Jacobians and state space there; `effect_jacobian`
differentiates the residuals with respect to the parameters of an effect; `linearization` assembles the model and
iterates the point.
"""
