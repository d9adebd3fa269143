"""Comparison of training mixtures: train each row, let it walk, and judge the claims."""
