"""Calibration of recorded sensors: noise, bias, axes, wrenches, cameras, hand and eye."""
