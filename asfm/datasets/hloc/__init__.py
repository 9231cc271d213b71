"""Keypoints and matches in hloc's HDF5 layout."""
