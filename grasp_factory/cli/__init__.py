"""The command line: parse the options with click, call one function, print the result."""
