"""Blur faces and licence plates in a session, and say what was found."""
