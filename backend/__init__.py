"""Back-end, from tracks to poses and landmarks: initialisation, triangulation, bundle adjustment, covariances."""
