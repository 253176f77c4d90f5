"""From a mission to a reconstructed entry.

In: a `Mission`, the effects that are added to it. Out: a `Reconstruction`: filter pass, smoothed states, trajectory,
checks of all constraints, and the inputs that they were computed from; data only.

Read in this order. `load` reads telemetry and atmosphere and applies what events of the flight change in the telemetry,
`forward_model` builds the model of planet, air and vehicle, `parachute` and `constraints` the measurements that the
filter uses, `entry_state` the state at entry and its correction, `redundancy` decides which of two IMUs is at fault
where they disagree, `dynamics_filling` fills stretches that no IMU has by the vehicle's rotational dynamics, and
`reconstruct` puts the filter's problem together and runs it. `plausibility` checks a record against physics,
`fault_hypotheses` lists what may be wrong with it, `causes` ranks these hypotheses, `record_comparison` compares it
with the record of another IMU, `ground_height` compares the altimeter with the landing, and `trust` judges a
reconstruction by these.
"""
