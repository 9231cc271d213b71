"""Imaging sonar simulator by ray casting, with ground truth: poses, elevations and noise-free images."""
