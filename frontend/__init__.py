"""From images to tracks: denoising, features, matches."""
