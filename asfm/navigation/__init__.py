"""Odometry, depth and attitude: read at the frames' stamps, cleaned and checked against each other."""
