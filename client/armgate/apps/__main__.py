"""``python -m armgate.apps`` is ``armgate``."""

from armgate.apps.cli import main

if __name__ == "__main__":
    main()
