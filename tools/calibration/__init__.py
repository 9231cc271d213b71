"""Calibration of the simulator from recordings."""
