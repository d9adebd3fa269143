"""Gaits: at run time, their training and their trials."""
