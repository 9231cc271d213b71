"""Factor graph in GTSAM: factors, bundle adjustment and marginal covariances."""
