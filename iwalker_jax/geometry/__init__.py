"""Splines and arc length: plain geometry that every other room stands on."""
