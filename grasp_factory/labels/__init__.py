"""Compute the label and the quality score from recorded arrays."""
