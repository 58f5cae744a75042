"""Least squares of a model's free parameters: objective, quadratic model and damped step, convergence, iteration."""
