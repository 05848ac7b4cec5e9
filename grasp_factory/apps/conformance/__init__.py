"""Checks that every policy, robot and object set must pass, of this package or of a user."""
