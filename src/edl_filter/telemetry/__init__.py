"""Telemetry: readers, cleaning, smoothing, calibration; records in body axes come out."""
