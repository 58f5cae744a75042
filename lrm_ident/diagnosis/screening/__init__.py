"""Screening of a fit: every candidate effect alone, linearised, on what the fit leaves."""
