"""Make stores: find the missing blocks, run them on worker processes, report the result."""
