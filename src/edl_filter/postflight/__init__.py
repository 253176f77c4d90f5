"""Post-flight analysis: air data, atmosphere and aerodynamic coefficients along the reconstructed trajectory.

In: the reconstruction (smoothed trajectory, telemetry, mission), the planet, the preflight atmosphere and the
aerodynamic database. Out: the air-relative state with sigmas (`airdata.AirData`), the state at every event
(`events.Event`), and atmosphere, coefficients and their comparison with the database (`derive.PostflightResult`). This
package does not change the estimate.

Read in this order: `airdata` and `events`; then `derive`, which runs the layer on the arrays of `inputs` (`flight`
makes them from a reconstruction): `rates` and `moments` (smoothing, Euler's equations), `density` and `atmosphere` (the
two atmospheres), `coefficients`, `comparison`, `measured` and `averages`, which `atmosphere_case` runs once for each
atmosphere; `windows`, `two_atmospheres` and `oscillation`.
"""
