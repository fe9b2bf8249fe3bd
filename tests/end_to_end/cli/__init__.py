"""Commands of the command line beside a running daemon."""
