"""Navigation sensors: odometry, depth and attitude, read at the frame times, filtered and checked for consistency."""
