"""Run the command line as ``python -m asfm``."""

from asfm.cli import main

if __name__ == "__main__":
    main()
