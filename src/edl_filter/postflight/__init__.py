"""Post-flight: what the reconstructed trajectory means in the air.

In: the smoothed trajectory, the planet and the preflight atmosphere. Out: air-relative state with sigmas along
the flight (`airdata`) and the state at every event (`events`). Nothing here changes the estimate.
"""
