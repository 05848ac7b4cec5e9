"""Load robots, policies and other rows of tables from the user's files and installed packages."""
