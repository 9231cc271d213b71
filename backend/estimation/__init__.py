"""One estimation round: triangulate tracks, reject outliers, estimate their noise, adjust poses and points."""
