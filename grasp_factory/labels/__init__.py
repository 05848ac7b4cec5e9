"""The label rule and the quality score, from recorded arrays alone."""
