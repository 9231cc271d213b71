"""Keypoints and matches in the HDF5 layout of hloc (Hierarchical-Localization)."""
