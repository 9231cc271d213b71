"""Feature matching: keypoints of two frames to matches, and the outlier filters."""
