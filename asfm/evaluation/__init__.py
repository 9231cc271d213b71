"""Evaluation against ground truth: pose errors, covariances, matches and denoising."""
