"""The command line as ``python -m granite_lab``."""

from granite_lab.cli import main

if __name__ == "__main__":
    main()
