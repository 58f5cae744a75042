"""Screening of a fit: every candidate effect alone, linearised, on the residual."""
