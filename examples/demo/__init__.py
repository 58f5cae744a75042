"""The whole story on a simulated arm: measure, fit, find what is missing, deploy, and see where the tip lands."""
