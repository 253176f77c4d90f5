"""The linear model: residuals, Jacobians and noise about one linearisation point.

In: a reconstruction with its mission, and the effects in the model. Out: a `LinearizedModel` (residuals, Jacobians,
state space and noise about one point), and the Jacobian of the residuals with respect to the parameters of an effect.

Read in this order: `flight_case` (what does not change while a flight is diagnosed), `stated_parameters` (constant
nuisance parameters), `linearization_point` (the state, air and vehicle about which the model is linear), `linear_model`
(residuals, Jacobians and state space there), `effect_jacobian` (derivatives with respect to an effect),
`linearization` (assembles the model and iterates the point), `credible_model` (estimates scale and correlation lengths
of the database's error, and selects the point about which a flight is diagnosed).
"""
