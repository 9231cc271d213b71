"""Feature detection: an image inside its echo mask to keypoints with patches."""
