"""Selection: which effect is missing, by Bayesian model comparison.

In: a `LinearizedModel`, and candidate effects. Out: a `Ranking` of hypotheses with their evidence, and a `Verdict` with
their probabilities.

Read in this order: `screening` regresses the residuals on every effect of the catalogue; `map_fit` fits the parameters
of the first ones of the screening through all steps of the prediction; `time_scan` finds the times from which a fit
starts where the model fails; `outer_loop` repeats the fit about new reconstructions;
`hypothesis` computes evidence and held-out score of each; `ranking` compares them with no effect and with an unmodelled
acceleration; `decision` turns evidence into probabilities and a verdict; `disambiguation` finds the measurement that
would distinguish two names; `evidence_profile` is the evidence of one effect against one of its places.
"""
