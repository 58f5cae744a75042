"""TCP error of the deployed model at new poses of simulated worlds that go on after the measurement."""
