"""The mathematics that the daemon and the offline tool share: SI units, float64, batches first `(N, ...)`."""
