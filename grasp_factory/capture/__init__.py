"""Record real sensors, calibrate them, and make stores of what was recorded."""
