"""Diagnosis: where the model fails, which physical effect is missing, and what is left.

Data flow: `comparison` sets prediction beside measurement along one dead-reckoned path, `sensitivity` says how the
differences hang on what is uncertain, `motion` and `timeline` put that into the order of time, `whitening` takes the
uncertainty out in one pass of a Kalman filter, and on the white residuals `where`, `ranking` and `remainder` answer the
three questions. Ranking goes from `trying` the catalogue over refitted `hypotheses` to a `verdict`.
"""
