"""The measurement model of an inertial measurement unit (IMU), for everything that predicts or corrects its readings.

In: specific force, angular rate, the instrument's constant errors, and its position from the centre of mass. Out: what
the instrument reads of a motion, the motion from what it read, and the derivatives of both.

Read in this order. `sensor_errors` holds bias, scale and misalignment: the model, its inverse, the inverse as linear
maps for the strapdown kernel, and the Jacobian. `compiled_corrections` computes these maps. `lever_arm` holds the
acceleration of the instrument's place against the centre of mass. The simulator and the effects apply the model;
navigation, telemetry and diagnosis undo it.
"""
