"""Denoising: images to echo masks, and images to clean images."""
