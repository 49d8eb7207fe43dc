"""``python -m geoident`` is the command ``geoident``."""

from geoident.cli import main

if __name__ == "__main__":
    main()
