"""The webcam as a tracker: rendered photos through the whole chain, and what the covariance is worth."""
