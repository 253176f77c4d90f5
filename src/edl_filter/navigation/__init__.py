"""Navigation: the trajectory and the sensor errors, from IMU samples and everything else that was measured.

In: an IMU record, an initial state with its covariance, constraints (other measurements, each at one time), the planet.
Out: filtered and smoothed states with covariances at the epochs, the smoothed trajectory at every sample, and a check
of every constraint against all the others.

Read in this order. `layout` defines the filter's vector, an error about a reference state; `initial` its start.
`rotation_corrections` (coning and sculling) and `unresolved` (noise of motion within a sample) belong to `increments`,
which prepares samples for the integrator; `strapdown` propagates states over them, `noise` (with `compiled_noise`)
gives the process noise, and `propagation` adds the attitude computed on board. `constraints` and `parachute` hold the
measurement models. `estimator` is the interface of the filters: `ukf` (unscented) with its compiled form
`compiled_ukf` (the default, with `compiled_states`), and `ekf` (extended) with the transition matrices of
`error_dynamics`. `filter` runs one of them through the epochs and `smoother` goes back; `iterated` repeats both where
samples were filled. `trajectory` interpolates between the epochs. Along it, `rotational_dynamics` predicts how the
vehicle moves, `motion_model` makes a stochastic model of it, and `motion_smoother` predicts what an IMU would have
read where readings are lost. `leave_one_out` checks the constraints, with the `information` that each contributes.
Measurements far from their prediction are given less weight on request (`robust`); `outlier_screening` examines
readings by their `consensus`, and `recovery` runs the filter again where its state is the outlier.
"""
