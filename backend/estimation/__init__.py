"""One round of estimation: triangulate, reject, weigh, adjust."""
