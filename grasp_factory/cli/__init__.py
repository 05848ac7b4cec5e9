"""The command line: click parses, one function is called, the result is printed."""
