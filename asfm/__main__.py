"""Entry point of ``python -m asfm``."""

from asfm.cli import main

if __name__ == "__main__":
    main()
