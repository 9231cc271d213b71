"""Evaluation of denoising: methods, metrics, and their table."""
