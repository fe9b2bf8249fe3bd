"""`python -m traverse`: the command line."""

from traverse.cli.__main__ import main

if __name__ == "__main__":
    main()
