"""The model as it is deployed: state of its session effects, and held-out error."""
