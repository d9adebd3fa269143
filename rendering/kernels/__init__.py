"""Compiled kernels that trace and shade."""
