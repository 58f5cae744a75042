"""Benchmark "which effect is missing": three small data sets with their truth, and a scorer for anybody's answers."""
