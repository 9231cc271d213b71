"""Imaging sonar by ray casting, with the truth that no recording has: elevation, noise-free image and pose."""
