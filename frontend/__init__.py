"""Front-end, from images to tracks: denoising, features, matching, tracking, and verification of loops."""
