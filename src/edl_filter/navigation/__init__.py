"""Navigation: strapdown propagation of sigma points, an error-state UKF on filterpy, and the smoother.

The way of the data: `increments` prepares samples for the integrator, `strapdown` propagates sigma
points over them, `ukf` wraps that in filterpy, `constraints` says what is known besides the IMU,
`filter` walks through the epochs forwards, `smoother` backwards, and `trajectory` gives the smoothed
path at every sample.
"""
