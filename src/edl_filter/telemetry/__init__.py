"""Telemetry: from files to records in body axes.

In: a flight file (HDF5), an IMU log in CSV with its specification (YAML), or Spirit's and Opportunity's entry telemetry
(PDS volume, or the compact form of its tables that the package ships). Out: `record.Telemetry`, that is IMU records
(means over adjoining intervals, SI units, body axes), on-board attitude, altimeter, and the stated initial state,
events and fixes. An error in a file raises an `InputError` that names the file and the row or key.

Read in this order:

1. `record`: the records, the only thing that later stages depend on.
2. `hdf5_checks`, `flight_file`, `flight_file_writer`: reader and writer of flight files. `csv_log` and `csv_spec`:
   conversion of a CSV log into a flight file.
3. `fetch`, `pds3`, `mer_compact`, `mer_archive`, `mer_cleaning`: download, reader of PDS tables, their compact form,
   correction of MER's tables. `increment_clock` (clock of an IMU that counts increments), `mer_segments`,
   `mer_register`, `joining`, `mer_flight`: from the tables to segments in body axes, and to one record.
4. `time_stamps`, `quantisation`: times that scatter, and steps of the readings. `sample_checks`, `resampling`,
   `transfer`, `spikes`, `noisy_stretches`, `parity`, `disagreement`, `clock_drift`: missing, bad and noisy samples, by
   one IMU and by the comparison of two. `rest_drift`: a force at rest that is not constant. `triad_delay`: rates
   that are late against the forces. `partial_readings`: a triad of which one axis is lost. `sample_filling`,
   `sample_repair`: samples are filled.
5. `smoothing`: batch polynomial, low-pass, rates and angular accelerations. `calibration`, `relative_calibration`:
   lever-arm correction, bias, misalignment, scale and clock of one IMU relative to another.
6. `clock`: spacecraft clock to UTC.
"""
