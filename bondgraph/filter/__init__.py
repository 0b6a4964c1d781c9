"""Filter: unscented Kalman filters over compiled models, innovations and consistency."""
